// The run for which `b4mrl benchmark run --learner COMMAND --name NAME` has started this program:
//
//   auto run = b4mrl::ReadBenchmarkRun();
//   auto client = b4mrl::Client::Connect(run->endpoint);
//   auto bench = client->FindBenchmark(run->benchmark, run->ledger);
//
// The program trains, leaves one of two files in the folder `out`, and ends with exit code 0:
// "agent.h5", which data/d4rl/agent_file.h writes, or "returns.json", with returns that it has
// measured itself: {"returns": [...], "updates": N}. It may leave "curve.json" as well, with
// returns from before its last update: {"curve": [{"updates": N, "returns": [...]}, ...]}. What an
// earlier attempt has left of these was removed.
#pragma once

#include <cstdint>
#include <string>

#include "proto/base/status.h"

namespace b4mrl {

struct BenchmarkRun {
  std::string endpoint;   // B4MRL_ENDPOINT: of a daemon for the run
  std::string benchmark;  // B4MRL_BENCHMARK: its name
  uint64_t seed = 0;      // B4MRL_SEED
  uint64_t updates = 0;   // B4MRL_UPDATES: how long to train
  uint64_t ledger = 0;    // B4MRL_LEDGER: where the runner wants its use counted; 0: nowhere
  std::string out;        // B4MRL_OUT: a folder
};

// Reads the run from the program's environment variables. kFailedPrecondition: the runner has not
// started this program; kInvalidArgument: a number is none. No other thread may set variables.
Result<BenchmarkRun> ReadBenchmarkRun();

}  // namespace b4mrl
