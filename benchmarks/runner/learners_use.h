// What a start of a user's learner has used. Thread rule: the client's.
#pragma once

#include <cstdint>

#include "benchmarks/records/learned.h"
#include "client/client.h"
#include "proto/base/clock.h"

namespace b4mrl {

// Since `start`, with the totals of its ledger.
inline LearnersUse UseOf(Client& client, uint64_t ledger, Clock::time_point start) {
  LearnersUse use = {.seconds = SecondsSince(start)};
  if (const auto counts = client.ReadLedger(ledger); counts.ok()) {
    use.ledger = {{"simulator_steps", counts->steps},
                  {"query_rows", counts->query_rows},
                  {"dataset_rows", counts->dataset_rows}};
  }
  return use;
}

}  // namespace b4mrl
