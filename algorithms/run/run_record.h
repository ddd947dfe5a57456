// The options of a run, and the two files that keep them in the run's folder: run.json, from which
// the run is resumed, and config.toml, with which it is repeated. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/base/learner.h"
#include "proto/base/status.h"

namespace b4mrl {

inline constexpr uint32_t kMaxTrainingThreads = 64;

struct TrainOptions {
  // Identity: runs with equal values of these fields compute equal numbers. Resuming keeps them.
  std::string algorithm;
  std::string environment;
  std::string simulator;         // perturbations as the user wrote them; "" is the true environment
  std::string world;             // perturbations of the true environment at evaluations
  std::string dataset;           // "" for none
  std::string corruption;        // of the dataset, as the user wrote it; "" for none
  uint64_t corruption_seed = 0;  // of the corruption's noise
  std::string transitions = "stored";  // rule for the dataset's next observations, or "d4rl"
  uint32_t history_length = 1;
  uint64_t seed = 0;
  Precision precision = Precision::kFp32;
  Hyperparameters hyperparameters;

  // Length of the run and of its intervals, in updates; these fields may change on resuming.
  uint64_t updates = 1'000'000;
  uint64_t eval_every = 10'000;
  uint32_t eval_episodes = 10;
  uint64_t log_every = 1'000;
  uint64_t checkpoint_every = 10'000;
  std::optional<double> stop_at_score;  // normalised score that ends the run
  uint32_t threads = 1;

  std::string folder;
  bool resume = false;
  std::string command;  // command line that began the run, for a shell
};

// A folder name that distinguishes runs: "HalfCheetah-hymopo-gravity-medium-s0", with the
// corruption behind the dataset ("medium+hidden-high"), a corruption seed above 0 ("+c1"), the
// rule d4rl ("+d4rl"), a perturbed world ("in-action-delay") and a history above 1 ("h3"). It has
// only letters, digits and ".,=+-_", and at most kMaxRunNameBytes bytes. If these limits change the
// name, or the dataset is of another environment, the name ends with a hash of the unchanged name.
inline constexpr size_t kMaxRunNameBytes = 200;
std::string RunName(const TrainOptions& options, const LearnerNeeds& needs);
// The folder of a run without --out, "runs/NAME". A run that was begun with its dataset's name
// alone writes the version into its record and configuration: where that is resumed by the whole
// name, the folder is the one it has.
std::string FolderOfRun(const TrainOptions& options, const LearnerNeeds& needs);

// What computed one session of a run.
struct RunSession {
  std::string version;  // of b4mrl
  std::string blas_kernel;
  // "" in records of older versions.
  std::string processor;
  std::string commit;        // of the program; "" also if it was not known
  std::string architecture;  // for which learners were compiled
  bool operator==(const RunSession&) const = default;
  // Whether the other session is known to compute the same numbers. Equal commits that end with
  // "-dirty" may be different programs.
  bool ComputesAs(const RunSession& other) const {
    return version == other.version && blas_kernel == other.blas_kernel && commit == other.commit &&
           architecture == other.architecture;
  }
  // "version 0.1.0 (commit 3f2a9c0d1e4b) for native (rocketlake) on BLAS kernel SkylakeX"
  std::string Text() const;
};
RunSession PresentSession();

// Writes run.json, atomically. `before`: the sessions in the run's earlier record; the present
// session is added to them if it differs from the last of them.
Status WriteRunRecord(const TrainOptions& options, std::span<const RunSession> before = {});

// Writes config.toml, atomically: every option and hyperparameter in force, so that `b4mrl train
// --config FILE --out FOLDER` repeats the run.
Status WriteRunConfiguration(const TrainOptions& options);

// kFailedPrecondition if options.folder holds checkpoints and options.resume is not set, or none
// and what a training from the first update would replace: a finished run, the model of another
// one, or files that are no run's. kInvalidArgument if it is set and options.updates are fewer than
// the newest checkpoint has, which the folder's files would then deny.
Status CheckEarlierRun(const TrainOptions& options);

struct RunRecord {
  TrainOptions options;  // without hyperparameters, folder and resume
  std::vector<std::pair<std::string, std::string>> hyperparameters;  // as users write them
  std::vector<RunSession> sessions;                                  // oldest first
};
// Whether the record is of a run that computes the numbers of one with `options`: its identity and
// its hyperparameters are the same, but for those without effect. A record of an earlier version
// lacks newer hyperparameters.
bool IsRecordOf(const RunRecord& record, const TrainOptions& options);
bool HasRunRecord(const std::string& folder);
// kIoError if the folder has no run.json; kDataLoss if run.json cannot be parsed, or holds a number
// outside its option's range (the message names the option and the range).
Result<RunRecord> ReadRunRecord(const std::string& folder);

}  // namespace b4mrl
