#include "algorithms/experience/offline_batches.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace b4mrl {
namespace {

constexpr double kStdEpsilon = 1e-3;
constexpr double kScaledReturnRange = 1000;

Normaliser IdentityNormaliser(size_t observation_size) {
  return {std::vector<float>(observation_size, 0.0f), std::vector<float>(observation_size, 1.0f)};
}

Result<float> RewardScale(const DatasetStats& stats, const std::string& dataset) {
  const double range = stats.scores.max_return() - stats.scores.min_return();
  if (stats.scores.episodes() >= 2 && range > 0) {
    return static_cast<float>(kScaledReturnRange / range);
  }
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("rewards of {} cannot be scaled by its range of returns, which is {} "
                            "over {} complete episodes",
                            dataset, range, stats.scores.episodes()));
}

}  // namespace

Status CheckOfflineBatches(const LearnerContext& context) {
  return CheckRowsPerUpdate(context, "batch-size", context.hyperparameters.Unsigned("batch-size"));
}

Result<OfflineBatches> OfflineBatches::Open(const LearnerContext& context,
                                            const OfflineBatchOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(TrainingDataset dataset,
                         TrainingDataset::Open(context, options.batch_size));
  B4MRL_ASSIGN_OR_RETURN(const DatasetStats stats, dataset.remote().Stats());
  Normaliser normaliser = options.normalise
                              ? Normaliser::Of(stats, kStdEpsilon)
                              : IdentityNormaliser(dataset.remote().observation_size());
  float reward_scale = 1;
  if (options.scale_rewards) {
    B4MRL_ASSIGN_OR_RETURN(reward_scale, RewardScale(stats, context.dataset));
  }
  return OfflineBatches(context, options, std::move(dataset), std::move(normaliser), reward_scale);
}

OfflineBatches::OfflineBatches(const LearnerContext& context, const OfflineBatchOptions& options,
                               TrainingDataset dataset, Normaliser normaliser, float reward_scale)
    : dataset_(std::move(dataset)),
      normaliser_(std::move(normaliser)),
      reward_scale_(reward_scale),
      action_max_(options.action_clip > 0 ? static_cast<float>(1 - options.action_clip)
                                          : std::numeric_limits<float>::infinity()),
      action_scale_(context.ActionScale()),
      batch_(context.observation_size(), context.action_size(), options.batch_size) {}

Result<TransitionBatch<float>> OfflineBatches::Next() {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, dataset_.Next());
  normaliser_.Apply(rows.observations, batch_.observations.view());
  normaliser_.Apply(rows.next_observations, batch_.next_observations.view());
  batch_.SetActions(rows.actions, action_scale_);
  for (float& action : batch_.actions.values()) {
    action = std::clamp(action, -action_max_, action_max_);
  }
  batch_.SetOutcomes(rows.rewards, rows.terminals);
  for (float& reward : batch_.rewards) reward *= reward_scale_;
  return batch_.view();
}

PolicyWeights OfflineBatches::WithInputs(PolicyWeights policy) const {
  policy.observation_mean = normaliser_.mean;
  policy.observation_std = normaliser_.std;
  policy.observation_mask = dataset_.mask();
  return policy;
}

void OfflineBatches::Save(CheckpointWriter& writer) const {
  writer.Floats("normaliser/mean", normaliser_.mean);
  writer.Floats("normaliser/std", normaliser_.std);
  dataset_.Save(writer);
}

Status OfflineBatches::Load(CheckpointReader& reader, uint64_t next_batch) {
  reader.FloatsInto("normaliser/mean", normaliser_.mean);
  reader.FloatsInto("normaliser/std", normaliser_.std);
  return dataset_.Load(reader, next_batch);
}

}  // namespace b4mrl
