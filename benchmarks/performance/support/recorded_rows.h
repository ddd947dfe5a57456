// Recorded observations and actions, for the measurements of queries.
#pragma once

#include <cstddef>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

inline constexpr size_t kRecordedRows = 16'000;

struct RecordedRows {
  std::vector<float> observations;  // rows x 17
  std::vector<float> actions;       // rows x 6
  size_t rows() const { return observations.size() / kCheetahObservationSize; }
};

// kRecordedRows rows of HalfCheetah: a behaviour policy (Options::agent_file) draws the actions in
// the real environment.
Result<RecordedRows> RecordRows(Client& client, const Options& options);

}  // namespace b4mrl::perf
