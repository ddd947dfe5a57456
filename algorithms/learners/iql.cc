// IQL: implicit Q-learning, offline (Kostrikov, Nair and Levine 2021).
//
//   D      dataset of (s, a, r, s', d), as the daemon serves it, corrupted if so asked
//   V      value, Q twin critics, Q' their slow copies, pi actor (rl/iql_core.h has the losses)
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D
//               one step of V towards the `expectile` of q = min Q'(s, a)
//               one step of pi towards a, with weight min(exp(temperature (q - V(s))), weight-max)
//               one step of Q towards r + gamma V(s');  Q' follows Q by tau
//
// No action outside D is ever evaluated. The defaults are Manchery/iql-pytorch's as its MuJoCo
// command runs it, since that is what the paper's authors ran. The original,
// ikostrikov/implicit_q_learning, is --actor gaussian --initialisation orthogonal
// --reward-scaling return-range --action-clip 1e-5 --normalise 0.
#include <memory>
#include <utility>

#include "algorithms/cores/iql_core.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/learners.h"
#include "algorithms/learners/offline_learner.h"

namespace b4mrl {
namespace {

constexpr std::string_view kBoth =
    "Manchery/iql-pytorch, which the paper's authors ran, and the original";

// Places in Hyperparameter::choices.
enum Actor { kDeterministic, kGaussian };
enum Initialisation { kTorch, kOrthogonal };
enum RewardScaling { kNone, kReturnRange };

constexpr Hyperparameter kHyperparameters[] = {
    {"actor", kDeterministic, 0, 1, true, "fitted by weighted squared error or by likelihood", "",
     "Manchery/iql-pytorch, which the paper's authors ran; the original: gaussian",
     "deterministic|gaussian"},
    {"initialisation", kTorch, 0, 1, true, "of the weights: PyTorch's uniform, or orthogonal", "",
     "Manchery/iql-pytorch; the original: orthogonal", "torch|orthogonal"},
    {"expectile", 0.7, 0, 1, false, "of the critics' values, which V approaches", "", kBoth},
    {"temperature", 3, 0, 1e6, false, "how much the advantage decides; 0: clone all", "", kBoth},
    {"weight-max", 100, 0, 1e9, false, "largest weight that an advantage gives", "", kBoth},
    {"cosine-updates", 1e6, 0, 1e12, true, "until the actor's learning rate is 0; 0: constant",
     "updates", kBoth},
    {"normalise", 1, 0, 1, true, "1: normalise observations, 0: do not", "",
     "Manchery/iql-pytorch's command for MuJoCo; its own default and the original: 0"},
    {"reward-scaling", kNone, 0, 1, true, "return-range: by 1000 / (largest - smallest return)", "",
     "Manchery/iql-pytorch; the original: return-range", "none|return-range"},
    {"action-clip", 0, 0, 0.5, false, "dataset actions are kept so far from +-1; 0: as they are",
     "half the action range", "Manchery/iql-pytorch; the original: 1e-5"},
    {"batch-size", 256, 1, 65'536, true, "of one update", "transitions", kBoth},
    {"hidden-width", 256, 1, 2048, true, "of each of the two hidden layers", "units", kBoth},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of V, actor and critics", "", kBoth},
    {"gamma", 0.99, 0, 1, false, "discount", "", kBoth},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update", "", kBoth},
};

IqlOptions CoreOptions(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  IqlOptions options;
  SetActorCriticOptions(context, context.observation_size(), options);
  if (values.Integer("actor") == kGaussian) options.actor = IqlActor::kGaussian;
  if (values.Integer("initialisation") == kOrthogonal) {
    options.initialization = Initialization::kOrthogonal;
  }
  options.value_learning_rate = values.Number("learning-rate");
  options.cosine_updates = static_cast<int64_t>(values.Number("cosine-updates"));
  options.expectile = values.Number("expectile");
  options.temperature = values.Number("temperature");
  options.weight_max = values.Number("weight-max");
  return options;
}

}  // namespace

std::span<const Hyperparameter> IqlHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateIql(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  const IqlOptions options = CoreOptions(context);
  B4MRL_ASSIGN_OR_RETURN(IqlCore<float> core, IqlCore<float>::Create(options));
  B4MRL_ASSIGN_OR_RETURN(
      OfflineBatches batches,
      OfflineBatches::Open(context,
                           {.batch_size = options.batch_max,
                            .normalise = values.Integer("normalise") == 1,
                            .scale_rewards = values.Integer("reward-scaling") == kReturnRange,
                            .action_clip = values.Number("action-clip")}));
  return std::unique_ptr<Learner>(
      std::make_unique<OfflineLearner<IqlCore<float>>>(std::move(core), std::move(batches)));
}

}  // namespace b4mrl
