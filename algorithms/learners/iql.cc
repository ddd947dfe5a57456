// IQL: implicit Q-learning, offline (Kostrikov, Nair and Levine 2021).
//
//   D      dataset of (s, a, r, s', d), as the daemon serves it, with corruptions if asked for
//   V      value, Q twin critics, Q' target critics, pi actor (cores/iql_core.h has the losses)
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D
//               one step of V towards the `expectile` of q = min Q'(s, a)
//               one step of pi towards a, with weight min(exp(temperature (q - V(s))), weight-max)
//               one step of Q towards r + gamma V(s');  Q' <- tau Q + (1 - tau) Q'
//
// No action outside D is ever evaluated. The defaults are those of Manchery/iql-pytorch's MuJoCo
// command, which the B4MRL paper's authors ran. The options of the original code,
// ikostrikov/implicit_q_learning, are --actor gaussian --initialisation orthogonal
// --reward-scaling return-range --action-clip 1e-5 --normalise 0.
#include <memory>
#include <utility>

#include "algorithms/cores/iql_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/offline_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kBoth =
    "Manchery/iql-pytorch, which the paper's authors ran, and the original";

IqlOptions CoreOptions(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  IqlOptions options;
  SetActorCriticOptions(context, context.observation_size(), options);
  if (values.Chosen("actor", "gaussian")) options.actor = IqlActor::kGaussian;
  if (values.Chosen("initialisation", "orthogonal")) {
    options.initialization = Initialization::kOrthogonal;
  }
  options.value_learning_rate = values.Number("learning-rate");
  options.cosine_updates = static_cast<int64_t>(values.Number("cosine-updates"));
  options.expectile = values.Number("expectile");
  options.temperature = values.Number("temperature");
  options.weight_max = values.Number("weight-max");
  return options;
}

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  const IqlOptions options = CoreOptions(context);
  B4MRL_ASSIGN_OR_RETURN(IqlCore<float> core, IqlCore<float>::Create(options));
  B4MRL_ASSIGN_OR_RETURN(
      OfflineBatches batches,
      OfflineBatches::Open(context,
                           {.batch_size = options.batch_max,
                            .normalise = values.Chosen("normalise", "true"),
                            .scale_rewards = values.Chosen("reward-scaling", "return-range"),
                            .action_clip = values.Number("action-clip")}));
  return MakeOfflineLearner(std::move(core), std::move(batches));
}

HyperparameterTable Table() {
  const HyperparameterTable own = {
      Choice("actor", "deterministic|gaussian", 0,
             "the actor: fitted to actions by weighted squared error, or by likelihood",
             "Manchery/iql-pytorch, which the paper's authors ran; the original: gaussian"),
      Choice("initialisation", "torch|orthogonal", 0,
             "initial weights: PyTorch's uniform ones, or orthogonal ones",
             "Manchery/iql-pytorch; the original: orthogonal"),
      Real("expectile", 0.7, {0, 1}, "expectile of the critics' values to which V is fitted",
           {.source = kBoth}),
      Real("temperature", 3, {0, 1e6},
           "inverse temperature of the advantage weights; 0 clones every action alike",
           {.source = kBoth}),
      Real("weight-max", 100, {0, 1e9}, "largest weight that an advantage gives an action",
           {.source = kBoth}),
      Whole("cosine-updates", 1e6, {0, 1e12},
            "updates until the cosine schedule takes the actor's learning rate to 0; 0: the "
            "rate is constant",
            {.unit = "updates", .source = kBoth}),
      NormaliseRow("Manchery/iql-pytorch's command for MuJoCo; its own default and the "
                   "original: false"),
      Choice("reward-scaling", "none|return-range", 0,
             "factor on rewards: 1, or 1000 / (largest - smallest return of an episode)",
             "Manchery/iql-pytorch; the original: return-range"),
      Real("action-clip", 0, {0, 0.5},
           "distance from +-1 that the dataset's actions are clipped to; 0: they are not",
           {.unit = "half the action range", .source = "Manchery/iql-pytorch; the original: 1e-5"}),
  };
  return own + ActorCriticRows(kBoth);
}

}  // namespace

Algorithm IqlAlgorithm() {
  return {.name = "iql",
          .description = "implicit Q-learning, offline on a dataset",
          .needs = {.dataset = true},
          .hyperparameters = Table(),
          .create = Create,
          .check = CheckOfflineBatches};
}

}  // namespace b4mrl
