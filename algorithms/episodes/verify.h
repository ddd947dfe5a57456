// Steps the rows of a dataset file again and compares: `b4mrl dataset verify`.
//
// A file of B4MRL's says in which world its rows were recorded and from which seeds its episodes
// start (data/d4rl/dataset_provenance.h); with its actions that determines every other number. The
// files of others hold at most the simulator's state before each step, infos/qpos and infos/qvel;
// each row is then a step of its own from that state, and other engines give other last digits.
// Thread rule: one thread. Errors: those of the daemon and the file; kInvalidArgument when the file
// does not fit the environment.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "algorithms/base/progress.h"
#include "client/client.h"
#include "data/d4rl/dataset_file_reader.h"
#include "proto/base/status.h"

namespace b4mrl {

// A number of a file that is not what stepping gives.
struct RowDifference {
  uint64_t row = 0;    // from 0
  std::string column;  // "next_observations[3]"
  double stored = 0;
  double stepped = 0;
};

// Steps a file of B4MRL's: the first row that differs in any bit, or no value if none does.
// kInvalidArgument when the file does not say how its episodes start.
Result<std::optional<RowDifference>> VerifyRecording(const DatasetFileReader& file, Client& client,
                                                     Progress& progress);

// How far the absolute differences of a column go, over rows; of a row with several numbers, its
// largest difference. A stored number that is NaN or infinite differs by infinity.
struct Deviation {
  double median = 0;
  double p99 = 0;  // 99th percentile
  double largest = 0;
  uint64_t largest_row = 0;
};

struct StateComparison {
  uint64_t rows = 0;
  uint64_t failed_rows = 0;  // that the simulator could not step; not among the deviations
  Deviation observations;    // of the state that was set
  Deviation next_observations, rewards;
};

// Sets every row's state in the true `environment` and takes its step. The file must have states.
Result<StateComparison> CompareStates(const DatasetFileReader& file, const std::string& environment,
                                      Client& client, Progress& progress);

}  // namespace b4mrl
