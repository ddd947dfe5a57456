#include "algorithms/list.h"

#include <vector>

#include "algorithms/experience/offline_batches.h"
#include "algorithms/learners/learners.h"
#include "algorithms/learners/model_based_options.h"

namespace b4mrl {

std::span<const Algorithm> Algorithms() {
  static const Algorithm kAlgorithms[] = {
      {"sac",
       "soft actor-critic, online in a simulator",
       {.simulator = true, .history = true},
       SacHyperparameters(),
       CreateSac},
      {"td3",
       "twin delayed deep deterministic policy gradient, online in a simulator",
       {.simulator = true, .history = true},
       Td3Hyperparameters(),
       CreateTd3},
      {"td3-bc",
       "TD3 with behaviour cloning, offline on a dataset",
       {.dataset = true},
       Td3BcHyperparameters(),
       CreateTd3Bc,
       CheckOfflineBatches},
      {"iql",
       "implicit Q-learning, offline on a dataset",
       {.dataset = true},
       IqlHyperparameters(),
       CreateIql,
       CheckOfflineBatches},
      {"mopo",
       "model-based, offline on a dataset: SAC on short rollouts in a learned model",
       {.dataset = true},
       MopoHyperparameters(),
       CreateMopo,
       CheckModelBased},
      {"h2o",
       "model-free hybrid: SAC on data and in a simulator, trusted as far as discriminators say",
       {.simulator = true, .dataset = true},
       H2oHyperparameters(),
       CreateH2o,
       CheckH2o},
      {"hymopo",
       "model-based hybrid: a learned correction of the simulator, SAC in the corrected one",
       {.simulator = true, .dataset = true},
       HymopoHyperparameters(),
       CreateHymopo,
       CheckModelBased},
  };
  return kAlgorithms;
}

Result<const Algorithm*> FindAlgorithm(std::string_view name) {
  std::vector<std::string_view> names;
  for (const Algorithm& algorithm : Algorithms()) {
    if (algorithm.name == name) return &algorithm;
    names.push_back(algorithm.name);
  }
  return UnknownName("algorithm", name, names);
}

}  // namespace b4mrl
