#include "algorithms/learners/h2o_options.h"

#include "algorithms/experience/training_dataset.h"
#include "algorithms/learners/core_options.h"

namespace b4mrl {

H2oOptions H2oOptionsOf(const LearnerContext& context, const DatasetStats& stats) {
  const Hyperparameters& values = context.hyperparameters;
  H2oOptions options;
  SetSacOptions(context, context.observation_size(), options);
  options.discriminator_batch_max = 2 * values.Integer("discriminator-batch");
  options.discriminator_learning_rate = values.Number("learning-rate");
  options.discriminator_noise = values.Number("discriminator-noise");
  options.ratio_min = values.Number("ratio-min");
  options.gap_samples = values.Integer("gap-samples");
  options.gap_noise =
      GapNoise(stats.observation_mean, stats.observation_std,
               values.Chosen("gap-noise-std", "data") ? GapNoiseStd::kData : GapNoiseStd::kPadded,
               values.Number("gap-noise"));
  options.gap_max = values.Number("gap-max");
  options.gap_weight = values.Number("gap-weight");
  options.gap_limit = values.Number("gap-limit");
  return options;
}

}  // namespace b4mrl
