// Short runs of every learner. For tests.
#pragma once

#include <atomic>
#include <string>
#include <string_view>
#include <utility>

#include "algorithms/list.h"
#include "algorithms/run/train_loop.h"
#include "tests/results.h"

namespace b4mrl {

// Small enough for a test, and set so that a run has much to remember: half of it ends amid a
// cycle, a schedule or a rollout. For every learner that has a hyperparameter of the name.
inline constexpr std::pair<std::string_view, double> kSmall[] = {
    {"hidden-width", 16},
    {"batch-size", 32},
    {"lanes", 2},
    {"warm-up", 100},
    {"actor", 1},  // Gaussian, which has more to remember
    {"cosine-updates", 50},
    {"steps-per-cycle", 40},
    {"updates-per-cycle", 20},
    {"discriminator-batch", 24},
    {"gap-samples", 2},
    {"ensemble-width", 16},
    {"ensemble-max-updates", 20},
    {"rollout-every", 20},
    {"rollout-rows", 100},
    {"chunk-rows", 30},
    {"model-retain", 2},
    {"real-ratio", 0.25},
};

// Of any learner of the list: what it needs decides what it trains on.
inline TrainOptions SmallRun(std::string_view algorithm, const std::string& folder) {
  const Algorithm* entry = Take(FindAlgorithm(algorithm));
  TrainOptions options;
  options.algorithm = algorithm;
  options.environment = "HalfCheetah";
  options.simulator = entry->needs.simulator ? "gravity" : "";
  options.dataset = entry->needs.dataset ? "HalfCheetah/small" : "";
  options.history_length = entry->needs.history ? 2 : 1;
  options.seed = 3;
  options.updates = 60;
  options.eval_every = 30;
  options.eval_episodes = 1;
  options.log_every = 10;
  options.checkpoint_every = 30;
  options.folder = folder;
  options.hyperparameters = Hyperparameters(entry->hyperparameters);
  for (const auto& [name, value] : kSmall) {
    if (options.hyperparameters.Find(name) == nullptr) continue;
    RequireOk(options.hyperparameters.Set(name, value));
  }
  return options;
}

inline TrainSummary RunTraining(const TrainOptions& options, Client& client) {
  const std::atomic<bool> stop = false;
  Progress quiet(true);
  return Take(Train(options, client, quiet, stop));
}

}  // namespace b4mrl
