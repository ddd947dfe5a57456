// Results: one JSON file a run, which says what was trained, how far, and how it scored after each
// evaluation. A run that goes on replaces its file.
//
// The file appears whole or not at all. A run that was cut off has a valid result, that of its last
// evaluation; one that has finished keeps its result until it has finished with more updates. Any
// process; one thread a call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/curve.h"
#include "proto/base/status.h"

namespace b4mrl {

// What a result says of the dataset of its run.
struct UsedDataset {
  std::string name;  // full: "HalfCheetah/medium-v0"
  uint64_t rows = 0;
  std::string sha256;          // of the file
  std::string columns_sha256;  // of the rows
};

// What a result says of how it came about, beside its run.
struct ResultOrigin {
  std::string budget;    // its name
  std::string commit;    // of the program; "" if it is not known
  uint64_t updates = 0;  // that the run was told to do
};

// What a run has come to, in words of a result.
struct RunOutcome {
  Curve curve;           // empty: there is no evaluation yet
  bool ended = false;    // whether training has ended in order
  std::string diverged;  // why its training diverged; "": it did not
  // Of a user's learner: what it was asked to do, and which command has done it.
  std::optional<uint64_t> planned_updates;
  std::string learner_sha256;
  std::string columns_sha256;  // of the rows that `b4mrl train` learned from; "": it used none
  std::string source = "own";  // "user": a learner of the user's own; "self-scored": by itself
  // JSON of these entries of a result.
  nlohmann::ordered_json returns = nlohmann::ordered_json::array();
  nlohmann::ordered_json hyperparameters = nlohmann::ordered_json::object();
  nlohmann::ordered_json sessions = nlohmann::ordered_json::array();
  nlohmann::ordered_json ledger;
  std::string processor;
};

struct RunResult {
  bool finished = false;           // the updates that it was told to do were done
  uint64_t updates = 0;            // of its last evaluation
  uint64_t planned_updates = 0;    // that it was told to do
  bool settled = false;            // its score is known to move no longer
  std::optional<double> score;     // of its last evaluation; none where the task has no reference
  double mean_return = 0;          // of its last evaluation
  double seconds = 0;              // of training, evaluations included; a kept ensemble is free
  std::string agent_sha256;        // of the agent's file; "": there was none
  std::string learner_sha256;      // of the command of a user's learner; "": it is not known
  std::string columns_sha256;      // of the rows that it learned from; "": it used none
  std::set<std::string> scorings;  // names of the further evaluations that it holds

  // Whether the run, which is to do so many updates, has finished with them or with more. A learner
  // of the user's own that was told to do so many decides itself when it has finished; its run is
  // not done if it has learned from other rows than those at hand.
  bool IsDone(const PlannedRun& run, uint64_t target) const;
  // Whether its dataset is known to hold other rows now than those that it learned from.
  bool IsOfOtherRows(const PlannedRun& run) const;
};

// What a result's run has in common with those of other seeds that it may be averaged with. Results
// on other rows of their dataset have another one. So have those of other perturbations, which the
// cell's id does not tell for a user's learner: that hangs on its benchmark's name, which may have
// meant another world before. And so have those that somebody else has trained or scored.
std::string CellKey(const nlohmann::ordered_json& result);

// The name of a result's dataset as plans have it (ShortName).
std::string DatasetName(const nlohmann::ordered_json& result);

// Whether a result says that its run has not finished because it diverged, and in as many bytes as
// its entry "diverged" may have for the reason.
inline constexpr size_t kMostDivergedBytes = 1'000;
bool HasDiverged(const nlohmann::ordered_json& result);

// Until which update the policy of a run of the project's learns, of a result's entries `source`
// and `hyperparameters`: its learning rate has then fallen to 0. Nothing: without end.
std::optional<uint64_t> LearnsUntil(std::string_view source,
                                    const nlohmann::ordered_json& hyperparameters);
// Whether a run's score is known to move no longer after so many updates: by its curve's fifths, or
// because its policy learns no more. Nothing: nobody can say.
std::optional<bool> HasSettled(const Fifths& fifths, uint64_t updates,
                               std::optional<uint64_t> learns_until);

// Where the results of a folder lie: in its folder "results" if it has one and holds no results
// itself, as the folder of a suite's runs does, else in itself.
std::string FolderOfResults(const std::string& folder);
// DIR/<name>-<id>.json.
std::string ResultPath(const std::string& results_folder, const PlannedRun& run);

// The file in a run's folder that keeps a further evaluation: what `b4mrl evaluate --json` prints.
std::string ScoringPath(const std::string& run_folder, const Scoring& scoring);

// Writes the result of a run from what `b4mrl train`, or a learner of the user's own, has left in
// its folder; `dataset` is unset for runs without one. Does nothing while the run has no
// evaluation, nor while there is a result that has come further: a finished one, of a run that goes
// on, or that of a run that was begun anew. Returns the updates of the run's last evaluation; 0:
// there is none. Errors: kIoError, kDataLoss; kFailedPrecondition: `dataset` has other rows than
// those that the run learned from.
Result<uint64_t> WriteResultOf(const PlannedRun& run, const std::string& run_folder,
                               const std::optional<UsedDataset>& dataset,
                               const ResultOrigin& origin, const std::string& results_folder);

// Adds to a run's result the benchmarks whose cells it fills and that it does not name yet: those
// of suites that have grown, or are new. Errors as above.
Status NameAllBenchmarks(const PlannedRun& run, const std::string& results_folder);

// The updates of the last evaluation of a run of `b4mrl train` in this folder; 0: there is none.
// Errors as above.
Result<uint64_t> EvaluatedUpdates(const std::string& run_folder);

// None if there is no such file. kDataLoss if it cannot be read.
Result<std::optional<RunResult>> ReadResult(const std::string& path);

}  // namespace b4mrl
