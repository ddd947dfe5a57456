#include "algorithms/learners/model_based_options.h"

#include <fmt/format.h>

#include <utility>

#include "algorithms/experience/training_dataset.h"
#include "algorithms/learners/core_options.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/folders.h"

namespace b4mrl {
namespace {

constexpr std::string_view kAuthors = "junming-yang/mopo, which the paper's authors ran";

HyperparameterTable RolloutRows() {
  return {
      Whole("rollout-every", 1000, {1, 1e9}, "length of a cycle: updates between two rollouts",
            {.unit = "updates", .source = kAuthors}),
      Whole("rollout-rows", 50'000, {1, 65'536},
            "rows of the dataset from which each cycle's rollouts start",
            {.unit = "rows", .source = kAuthors}),
      Whole("model-retain", 5, {1, 1000},
            "number of recent rollout cycles kept in the model's replay pool",
            {.unit = "cycles", .source = kAuthors}),
      Whole("rollout-lag", 0, {0, 1},
            "age of the policy that is rolled out: 0 the present one, 1 that of one cycle ago",
            {.unit = "cycles",
             .source = "ours: 0 is the published algorithm; 1 makes the next cycle's rollouts on "
                       "a thread of their own while updates go on"}),
      Real("real-ratio", 0.05, {0, 1}, "share of a batch that comes from the dataset",
           {.source = kAuthors}),
      Real("target-entropy", -3, {-1e3, 1e3},
           "entropy of the policy to which the entropy weight is adjusted",
           {.unit = "nats",
            .source = "junming-yang/mopo and the official code, in every task; OfflineRL-Kit and "
                      "SAC itself take minus the number of action dimensions"}),
  };
}

HyperparameterTable EnsembleRows() {
  return {
      Whole("ensemble-members", 7, {1, 64}, "networks of the model's ensemble",
            {.unit = "networks", .source = kAuthors}),
      Whole("ensemble-elites", 5, {1, 64},
            "best networks of the ensemble by hold-out loss, which rollouts draw from",
            {.unit = "networks", .source = kAuthors}),
      Whole("ensemble-width", 200, {1, 4096},
            "units in each of the four hidden layers of an ensemble's network",
            {.unit = "units", .source = kAuthors}),
      Choice("ensemble-initialisation", "torch|truncated-normal", 0,
             "initial weights of the ensemble's networks",
             "junming-yang/mopo keeps PyTorch's; the official code and OfflineRL-Kit draw a "
             "truncated normal and zero biases"),
      Real("ensemble-learning-rate", 1e-3, {1e-8, 1}, "Adam's learning rate for the ensemble",
           {.source = kAuthors}),
      Whole("ensemble-batch-size", 256, {1, 65'536},
            "rows in the batch of one gradient step of the ensemble",
            {.unit = "rows", .source = kAuthors}),
      Real("decay-factor", 1, {0, 1e3},
           "factor on the ensemble's weight decay, a coefficient for each layer",
           {.source = "junming-yang/mopo; 0.5 in the official code and in OfflineRL-Kit"}),
      Switch("input-scaling", false,
             "whether to standardise the ensemble's inputs (o, a) by the training rows' mean and "
             "deviation",
             "junming-yang/mopo computes them and never applies them; true in the official code "
             "and in OfflineRL-Kit"),
      Switch("bootstrap", false,
             "whether each network of the ensemble draws its own training rows with replacement",
             "junming-yang/mopo shows all networks the same batches; true in the official code "
             "and in OfflineRL-Kit"),
  };
}

HyperparameterTable EnsembleEndRows() {
  return {
      Choice("holdout", "tail|permutation", 0,
             "rows held out to test the ensemble: the file's last ones, or drawn at random",
             "junming-yang/mopo; the official code and OfflineRL-Kit permute"),
      Real("holdout-fraction", 0.1, {1e-6, 0.9}, "share of the rows held out to test the ensemble",
           {.source = "junming-yang/mopo; 0.2 in the official code and in OfflineRL-Kit"}),
      Whole("holdout-max", 1e9, {1, 1e9}, "upper limit on hold-out rows",
            {.unit = "rows",
             .source = "junming-yang/mopo has no limit; 1000 in the official code and in "
                       "OfflineRL-Kit"}),
      Whole("ensemble-max-updates", 800'000, {1, 1e12},
            "upper limit on the ensemble's gradient steps, even amid an epoch",
            {.unit = "updates", .source = "junming-yang/mopo, which ends the epoch first"}),
      Whole("ensemble-patience", 5, {1, 1e6},
            "epochs without a 1% improvement after which the ensemble's training stops",
            {.unit = "epochs",
             .source = "junming-yang/mopo and OfflineRL-Kit; 6 in the official code"}),
      WithoutEffect(
          Switch("ensemble-cache", true,
                 "whether to keep trained ensembles and to use one that was trained alike",
                 "ours: it changes no bit of a run")),
  };
}

// Whether ensemble.h5 can be read again (kMaxReadFloats): its longest arrays hold one number for
// each weight of all members.
bool HeldByFile(const DynamicsEnsembleOptions& options) {
  return static_cast<uint64_t>(LayoutOf(options).size()) <= kMaxReadFloats;
}

}  // namespace

Hyperparameter PenaltyRow(double value, std::string_view source) {
  return Real("penalty", value, {0, 1e3},
              "factor on the ensemble's largest predicted deviation, subtracted from the reward",
              {.source = source});
}

HyperparameterTable ModelBasedRows() {
  return RolloutRows() + ActorCriticRows(kAuthors) + EnsembleRows() + EnsembleEndRows();
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
  options.initialization = values.Chosen("ensemble-initialisation", "torch")
                               ? Initialization::kTorchUniform
                               : Initialization::kTruncatedNormal;
  options.learning_rate = values.Number("ensemble-learning-rate");
  options.batch_size = values.Integer("ensemble-batch-size");
  options.decay_scale = values.Number("decay-factor");
  options.bootstrap = values.Chosen("bootstrap", "true");
  options.scale_inputs = values.Chosen("input-scaling", "true");
  options.holdout_rule =
      values.Chosen("holdout", "tail") ? HoldoutRule::kTail : HoldoutRule::kPermutation;
  options.holdout_fraction = values.Number("holdout-fraction");
  options.holdout_max = static_cast<int64_t>(values.Number("holdout-max"));
  options.max_updates = static_cast<int64_t>(values.Number("ensemble-max-updates"));
  options.patience_epochs = values.Integer("ensemble-patience");
  options.seed = RoleSeed(context.seed, "ensemble");
  options.precision = context.precision;
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
  const bool keeps = context.hyperparameters.Chosen("ensemble-cache", "true");
  return {.run_folder = context.folder, .cache_folder = keeps ? DefaultCacheFolder() : ""};
}

}  // namespace b4mrl
