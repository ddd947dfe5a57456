// Results: one JSON file a run, which says what was trained, how far, and how it scored after each
// evaluation. A run that goes on replaces its file.
//
// The file appears whole or not at all. A run that was cut off has a valid result, that of its last
// evaluation. Any process; one thread a call.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "benchmarks/runner/plan.h"
#include "proto/base/status.h"

namespace b4mrl {

// What a result says of the dataset of its run.
struct UsedDataset {
  std::string name;  // full: "HalfCheetah/medium-v0"
  uint64_t rows = 0;
  std::string sha256;          // of the file
  std::string columns_sha256;  // of the rows
};

struct RunResult {
  bool finished = false;           // the updates that it was planned for were done
  uint64_t updates = 0;            // of its last evaluation
  std::optional<double> score;     // of its last evaluation; none where the task has no reference
  double mean_return = 0;          // likewise
  double seconds = 0;              // of training, evaluations included
  std::set<std::string> scorings;  // names of the further evaluations that it holds
};

// DIR/<name>-<id>.json.
std::string ResultPath(const std::string& results_folder, const PlannedRun& run);

// The file in a run's folder that keeps a further evaluation: what `b4mrl evaluate --json` prints.
std::string ScoringPath(const std::string& run_folder, const Scoring& scoring);

// Writes the result of a run from what `b4mrl train` has left in its folder; `dataset` is unset for
// runs without one. Does nothing while the run has no evaluation. Errors: kIoError, kDataLoss.
Status WriteResultOf(const PlannedRun& run, const std::string& run_folder,
                     const std::optional<UsedDataset>& dataset, const std::string& budget,
                     const std::string& results_folder);

// None if there is no such file. kDataLoss if it cannot be read.
Result<std::optional<RunResult>> ReadResult(const std::string& path);

}  // namespace b4mrl
