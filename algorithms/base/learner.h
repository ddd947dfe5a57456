// A learner, which `b4mrl train` runs. Read this first; then learners/bc.cc, the smallest learner.
//
// A learner is one file in learners/ that reads from top to bottom like the paper's pseudocode: its
// hyperparameters as a table, and three functions that matter, its own or those of a base class:
//   Prepare   once before the first update: random warm-up, a pre-pass over a dataset, an ensemble.
//             Returns early once `LearnerContext::stop` is set; a resumed run then repeats it from
//             the beginning.
//   Update    one gradient step, with the interaction that belongs to it
//   Policy    the policy as it is now, for evaluations and agent files
// The train loop (run/train_loop.h) counts updates, evaluates, logs, writes checkpoints and stops.
// A learner asks the daemon for everything else: it opens the sessions and datasets that it needs
// through `LearnerContext::client`, and never sees the simulator itself.
//
// Save and Load carry everything that decides the future, so that a run resumed from a checkpoint
// continues bit for bit (on the same kind of processor). All random numbers come from
// RoleSeed(run seed, role, index): they depend on their purpose, never on earlier draws.
// Thread rule: one thread. Ownership: the context outlives the learner.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/hyperparameters.h"
#include "algorithms/base/metrics.h"
#include "algorithms/base/progress.h"
#include "algorithms/nn/products/precision.h"
#include "algorithms/policy/inference.h"
#include "proto/base/role_seed.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Client;

inline constinit const std::atomic<bool> kNeverStops = false;

struct LearnerContext {
  Client* client = nullptr;
  EnvironmentSpec environment;           // of the true environment, on which scores are measured
  std::vector<NamedArgument> simulator;  // perturbations of the simulator to learn in
  std::string dataset;                   // "" for none
  std::vector<NamedArgument> corruption;
  uint64_t corruption_seed = 0;        // of the corruption's noise
  std::string transitions = "stored";  // rule by which the dataset's next observations are chosen
  uint32_t history_length = 1;
  uint64_t seed = 0;
  uint32_t threads = 1;  // that compute an update; results have equal bits for any number
  Precision precision = Precision::kFp32;  // of matrix products between two hidden layers
  uint64_t ledger = 0;  // of the daemon, which counts the learner's sessions and datasets; 0: none
  std::string folder;   // the run's; holds files that are too big for a checkpoint
  Hyperparameters hyperparameters;
  const std::atomic<bool>* stop = &kNeverStops;  // set when the run is to end soon

  int observation_size() const { return static_cast<int>(environment.observation.size()); }
  int action_size() const { return static_cast<int>(environment.action.size()); }
  // Factor of each action dimension from a learner's [-1, 1] to the environment's units.
  std::vector<float> ActionScale() const { return environment.ActionScale(); }
};

// Which dataset a learner has opened; empty without a dataset.
struct DatasetIdentity {
  std::string full_name;       // with its version, "HalfCheetah/medium-v0"
  std::string sha256;          // of its file
  std::string columns_sha256;  // of its rows (data/columns/columns_hash.h)
  // The one in force: files without next observations have "d4rl" whatever was asked for.
  std::string transition_rule;
};

class Learner {
 public:
  virtual ~Learner() = default;

  virtual Status Prepare(Progress& progress) = 0;
  virtual Status Update(MetricMeans& metrics) = 0;
  // The present policy with observation mean, std and mask. Its input is `history_length`
  // observations, oldest first.
  virtual PolicyWeights Policy() const = 0;

  // Load takes the place of Prepare when a run is resumed.
  virtual Status Save(CheckpointWriter& writer) = 0;
  virtual Status Load(CheckpointReader& reader) = 0;
  // Seconds that earlier sessions spent on what Prepare took up instead of repeating it, such as
  // half an ensemble: they belong to the run's cost, too.
  virtual double seconds_taken_up() const { return 0; }
  // Whether Save asks the daemon for nothing and a failed Update changes neither the state that
  // Save stores nor the metrics. A run of such a learner loses no update when its daemon is lost.
  virtual bool outlives_daemon() const { return false; }

  // Steps taken in the simulator so far, warm-up included and queries not.
  virtual uint64_t environment_steps() const { return 0; }
  virtual DatasetIdentity dataset_identity() const { return {}; }
};

// Seed of the environment in which a lane of an online learner starts its first episode. A run's
// actions can be stepped again from it (episodes/replay.h).
inline uint64_t TrainLaneSeed(uint64_t run_seed, uint32_t lane) {
  return RoleSeed(run_seed, "train-lane", lane);
}

// Deadline of each request of a training run. It is long so that a run survives a busy machine.
inline constexpr int64_t kLearnerDeadlineMs = 120'000;

struct LearnerNeeds {
  bool simulator = false;  // otherwise --simulator is refused
  bool dataset = false;    // then --dataset is required, otherwise refused
  bool history = false;    // supports --history above 1
  bool queries = false;    // asks the simulator for single steps, which not every one can answer
};

// An algorithm that `b4mrl train` knows. Each learner's file defines one Algorithm; list.cc lists
// all of them.
struct Algorithm {
  std::string_view name;  // "td3-bc"
  std::string_view description;
  LearnerNeeds needs;
  HyperparameterTable hyperparameters;
  Result<std::unique_ptr<Learner>> (*create)(const LearnerContext& context);
  // Checks combinations, which ranges of single values cannot: kInvalidArgument where values
  // contradict each other or the environment's sizes. Asks no daemon. nullptr: all combinations
  // fit.
  Status (*check)(const LearnerContext& context) = nullptr;
  // Default of --threads: 2 where the second core idles otherwise, since nothing else of the run
  // works while an ensemble trains.
  uint32_t threads = 1;
};

}  // namespace b4mrl
