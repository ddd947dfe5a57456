#include "algorithms/learners/h2o_options.h"

#include <catch2/catch.hpp>

#include "client/remote_dataset.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// No value is a core's default, and no two are equal.
constexpr Hyperparameter kTable[] = {
    {"learning-rate", 0.25, 0, 1, false, ""},
    {"initial-alpha", 0.75, 0, 1, false, ""},
    {"discriminator-batch", 24, 1, 64, true, ""},
    {"discriminator-noise", 0.375, 0, 1, false, ""},
    {"ratio-min", 0.125, 0, 1, false, ""},
    {"gap-samples", 3, 1, 64, true, ""},
    {"gap-noise", 0.5, 0, 1, false, ""},
    {"gap-noise-std", 0, 0, 1, true, "", {}, {}, "padded|data"},
    {"gap-max", 7, 0, 100, false, ""},
    {"gap-weight", 0.625, 0, 1, false, ""},
    {"gap-limit", 55, 0, 100, false, ""},
};

TEST_CASE("H2O's hyperparameters and its dataset's statistics reach its core") {
  LearnerContext context;
  context.environment.observation.dimensions.resize(2);
  context.environment.action.dimensions.resize(3);
  context.hyperparameters = Hyperparameters(kTable);
  const auto unit = GENERATE(GapNoiseStd::kPadded, GapNoiseStd::kData);
  RequireOk(context.hyperparameters.Set("gap-noise-std", static_cast<double>(unit)));
  const DatasetStats stats = {.observation_mean = {0.5, -4}, .observation_std = {2, 0.25}};
  const H2oOptions options = H2oOptionsOf(context, stats);
  CHECK(options.observation_size == 2);
  CHECK(options.action_size == 3);
  CHECK(options.alpha_learning_rate == 0.25);
  CHECK(options.initial_alpha == 0.75);
  CHECK(options.discriminator_batch_max == 2 * 24);  // as many rows of B as of D
  CHECK(options.discriminator_learning_rate == 0.25);
  CHECK(options.discriminator_noise == 0.375);
  CHECK(options.ratio_min == 0.125);
  CHECK(options.gap_samples == 3);
  CHECK(options.gap_noise == GapNoise(stats.observation_mean, stats.observation_std, unit, 0.5));
  CHECK(options.gap_max == 7);
  CHECK(options.gap_weight == 0.625);
  CHECK(options.gap_limit == 55);
}

}  // namespace
}  // namespace b4mrl
