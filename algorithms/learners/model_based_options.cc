#include "algorithms/learners/model_based_options.h"

#include <fmt/format.h>

#include <utility>

#include "algorithms/experience/training_dataset.h"
#include "algorithms/learners/core_options.h"
#include "data/hdf5/hdf5_file.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "junming-yang/mopo, which the paper's authors ran";

constexpr Hyperparameter kShared[] = {
    {"rollout-every", 1000, 1, 1e9, true, "between rollouts", "updates", kAuthors},
    {"rollout-rows", 50'000, 1, 65'536, true, "starts of the rollouts", "rows", kAuthors},
    {"model-retain", 5, 1, 1000, true, "whose rollouts are kept", "cycles", kAuthors},
    {"real-ratio", 0.05, 0, 1, false, "share of a batch that comes from the dataset", "", kAuthors},
    {"batch-size", 256, 1, 65'536, true, "of one update", "rows", kAuthors},
    {"hidden-width", 256, 1, 2048, true, "of each of the policy's two hidden layers", "units",
     kAuthors},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor, critics and entropy weight", "",
     kAuthors},
    {"gamma", 0.99, 0, 1, false, "discount", "", kAuthors},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update", "", kAuthors},
    {"target-entropy", -3, -1e3, 1e3, false, "of the policy", "nats",
     "junming-yang/mopo and the official code, in every task; OfflineRL-Kit and SAC itself take "
     "minus the number of action dimensions"},
    {"ensemble-members", 7, 1, 64, true, "of the model", "networks", kAuthors},
    {"ensemble-elites", 5, 1, 64, true, "best members, which rollouts use", "networks", kAuthors},
    {"ensemble-width", 200, 1, 4096, true, "of each of a member's four hidden layers", "units",
     kAuthors},
    {"ensemble-initialisation", 0, 0, 1, true, "of the members' weights", "",
     "junming-yang/mopo keeps PyTorch's; the official code and OfflineRL-Kit draw a truncated "
     "normal and zero biases",
     "torch|truncated-normal"},
    {"ensemble-learning-rate", 1e-3, 1e-8, 1, false, "Adam's", "", kAuthors},
    {"ensemble-batch-size", 256, 1, 65'536, true, "of one update of the model", "rows", kAuthors},
    {"decay-factor", 1, 0, 1e3, false, "of the weight decay c * sum(w^2)", "",
     "junming-yang/mopo; 0.5 in the official code and in OfflineRL-Kit"},
    {"input-scaling", 0, 0, 1, true, "standardise (o, a) by the training rows' statistics", "",
     "junming-yang/mopo computes them and never applies them; 1 in the official code and in "
     "OfflineRL-Kit"},
    {"bootstrap", 0, 0, 1, true, "each member draws its own rows with replacement", "",
     "junming-yang/mopo shows all members the same batches; 1 in the official code and in "
     "OfflineRL-Kit"},
    {"holdout", 0, 0, 1, true, "rows that test the model: the file's last, or drawn at random", "",
     "junming-yang/mopo; the official code and OfflineRL-Kit permute", "tail|permutation"},
    {"holdout-fraction", 0.1, 1e-6, 0.9, false, "share of the rows that test the model", "",
     "junming-yang/mopo; 0.2 in the official code and in OfflineRL-Kit"},
    {"holdout-max", 1e9, 1, 1e9, true, "at most so many of them", "rows",
     "junming-yang/mopo has no limit; 1000 in the official code and in OfflineRL-Kit"},
    {"ensemble-max-updates", 800'000, 1, 1e12, true, "at most, also amid an epoch", "updates",
     "junming-yang/mopo, which ends the epoch first"},
    {"ensemble-patience", 5, 1, 1e6, true, "without an improvement end the training", "epochs",
     "junming-yang/mopo and OfflineRL-Kit; 6 in the official code"},
    {"ensemble-cache", 1, 0, 1, true, "keep trained ensembles, and use one that was trained alike",
     "", "ours: it changes no bit of a run"},
};

// Whether ensemble.h5 can be read again: its longest arrays have a number for each weight of all
// members.
bool HeldByFile(const DynamicsEnsembleOptions& options) {
  return static_cast<uint64_t>(LayoutOf(options).size()) <= kMaxReadFloats;
}

}  // namespace

std::vector<Hyperparameter> WithModelBasedHyperparameters(std::span<const Hyperparameter> own) {
  std::vector<Hyperparameter> table(own.begin(), own.end());
  table.insert(table.end(), std::begin(kShared), std::end(kShared));
  return table;
}

DynamicsEnsembleOptions EnsembleOptionsOf(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  const int width = values.Integer("ensemble-width");
  DynamicsEnsembleOptions options;
  options.observation_size = context.observation_size();
  options.action_size = context.action_size();
  options.members = values.Integer("ensemble-members");
  options.elites = values.Integer("ensemble-elites");
  options.hidden = {width, width, width, width};
  options.initialization = static_cast<Initialization>(values.Integer("ensemble-initialisation"));
  options.learning_rate = values.Number("ensemble-learning-rate");
  options.batch_size = values.Integer("ensemble-batch-size");
  options.decay_scale = values.Number("decay-factor");
  options.bootstrap = values.Integer("bootstrap") == 1;
  options.scale_inputs = values.Integer("input-scaling") == 1;
  options.holdout_rule = static_cast<HoldoutRule>(values.Integer("holdout"));
  options.holdout_fraction = values.Number("holdout-fraction");
  options.holdout_max = static_cast<int64_t>(values.Number("holdout-max"));
  options.max_updates = static_cast<int64_t>(values.Number("ensemble-max-updates"));
  options.patience_epochs = values.Integer("ensemble-patience");
  options.seed = RoleSeed(context.seed, "ensemble");
  return options;
}

ModelRolloutOptions RolloutOptionsOf(const LearnerContext& context, std::vector<float> mask,
                                     std::optional<Termination> termination) {
  const Hyperparameters& values = context.hyperparameters;
  ModelRolloutOptions options;
  options.observation_size = context.observation_size();
  options.action_size = context.action_size();
  options.horizon = values.Integer("horizon");
  options.penalty = values.Number("penalty");
  options.chunk_rows = static_cast<int>(values.NumberOr("chunk-rows", options.chunk_rows));
  options.chunks_in_flight = static_cast<int>(values.NumberOr("chunks-in-flight", 1));
  options.seed = RoleSeed(context.seed, "rollouts");
  options.action_scale = context.ActionScale();
  options.mask = std::move(mask);
  options.termination = std::move(termination);
  return options;
}

Status CheckModelBased(const LearnerContext& context) {
  B4MRL_RETURN_IF_ERROR(
      CheckRowsPerUpdate(context, "batch-size * real-ratio",
                         static_cast<uint64_t>(RealRows(context.hyperparameters))));
  DynamicsEnsembleOptions options = EnsembleOptionsOf(context);
  if (options.elites > options.members) {
    return InvalidNumber("ensemble-elites", options.elites,
                         fmt::format("1..{}, the ensemble-members", options.members));
  }
  const int width = options.hidden.front();
  if (HeldByFile(options)) return Status();
  int most = width;
  while (most > 0 && !HeldByFile(options)) {
    --most;
    options.hidden.assign(options.hidden.size(), most);
  }
  return InvalidNumber("ensemble-width", width,
                       fmt::format("1..{} with {} ensemble-members in {}", most, options.members,
                                   context.environment.name));
}

EnsembleFiles EnsembleFilesOf(const LearnerContext& context) {
  const bool keeps = context.hyperparameters.Integer("ensemble-cache") == 1;
  return {.run_folder = context.folder, .cache_folder = keeps ? DefaultCacheFolder() : ""};
}

}  // namespace b4mrl
