// What a run was asked to do, and the two files that keep it in the run's folder: run.json, from
// which the run is resumed, and config.toml, with which it is repeated. Value types; no thread
// rule.
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
  // Identity: two runs that agree here compute the same numbers, and a resumed run must agree.
  std::string algorithm;
  std::string environment;
  std::string simulator;   // perturbations as users write them; "" is the true environment
  std::string dataset;     // "" for none
  std::string corruption;  // corruptions of the dataset as users write them; "" for none
  uint32_t history_length = 1;
  uint64_t seed = 0;
  Hyperparameters hyperparameters;

  // How far and how it is watched; may change when a run is resumed.
  uint64_t updates = 1'000'000;
  uint64_t eval_every = 10'000;
  uint32_t eval_episodes = 10;
  uint64_t log_every = 1'000;
  uint64_t checkpoint_every = 10'000;
  std::optional<double> stop_at_score;  // normalised score at which the run ends
  uint32_t threads = 1;

  std::string folder;
  bool resume = false;
  std::string command;  // the command line that began the run, as typed
};

// A folder's name that tells a run apart from others: "HalfCheetah-hymopo-gravity-medium-s0",
// with the corruption behind the dataset ("medium+hidden-high") and a history above 1 ("h3"). Of
// letters, digits and ".,=+-_", at most kMaxRunNameBytes long. Where the name leaves anything out,
// a hash of all these options follows.
inline constexpr size_t kMaxRunNameBytes = 200;
std::string RunName(const TrainOptions& options, const LearnerNeeds& needs);

// The program and BLAS kernel that computed a part of a run. Training is reproducible bit for bit
// among equal sessions.
struct RunSession {
  std::string version;  // of the program
  std::string blas_kernel;
  bool operator==(const RunSession&) const = default;
};
RunSession PresentSession();

// Writes run.json atomically. `before`: the sessions of the run's earlier record; the present
// session is added where it differs from the last of them.
Status WriteRunRecord(const TrainOptions& options, std::span<const RunSession> before = {});

// Writes config.toml atomically: every option and hyperparameter in force, so that `b4mrl train
// --config FILE --out FOLDER` repeats the run.
Status WriteRunConfiguration(const TrainOptions& options);

// kFailedPrecondition when the folder holds checkpoints and the run is not to be resumed.
Status CheckNoEarlierRun(const TrainOptions& options);

struct RunRecord {
  TrainOptions options;  // without hyperparameters, folder and resume
  std::vector<std::pair<std::string, std::string>> hyperparameters;  // as users write them
  std::vector<RunSession> sessions;                                  // oldest first
};
bool HasRunRecord(const std::string& folder);
// kIoError when the folder has none; kDataLoss when it cannot be understood or holds a number that
// no option takes, with its name and what is allowed.
Result<RunRecord> ReadRunRecord(const std::string& folder);

}  // namespace b4mrl
