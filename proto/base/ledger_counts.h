// What a ledger counts: the use that sessions and requests which name the ledger have made of the
// daemon's simulators and datasets. A value type; no thread rule.
#pragma once

#include <cstdint>

namespace b4mrl {

struct LedgerCounts {
  uint64_t steps = 0;         // simulated in lanes, each lane counted
  uint64_t episodes = 0;      // that ended in a step
  uint64_t query_rows = 0;    // rows of queries
  uint64_t dataset_rows = 0;  // rows served by Sample and Read

  bool operator==(const LedgerCounts&) const = default;
};

}  // namespace b4mrl
