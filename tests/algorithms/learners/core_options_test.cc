#include "algorithms/learners/core_options.h"

#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

LearnerContext ContextOf(std::span<const Hyperparameter> table) {
  LearnerContext context;
  context.environment.action.dimensions.resize(3);
  context.seed = 5;
  context.threads = 3;
  context.precision = Precision::kBf16;
  context.hyperparameters = Hyperparameters(table);
  return context;
}

// No value is a core's default.
constexpr Hyperparameter kTable[] = {
    {"hidden-width", 32, 1, 64, true, ""},    {"hidden-layers", 3, 1, 8, true, ""},
    {"batch-size", 48, 1, 64, true, ""},      {"learning-rate", 0.25, 0, 1, false, ""},
    {"gamma", 0.5, 0, 1, false, ""},          {"tau", 0.125, 0, 1, false, ""},
    {"initial-alpha", 0.75, 0, 1, false, ""}, {"target-entropy", -7, -9, 0, false, ""},
    {"policy-noise", 0.375, 0, 1, false, ""}, {"noise-clip", 0.625, 0, 1, false, ""},
    {"policy-frequency", 4, 1, 9, true, ""},  {"bc-alpha", 0.875, 0, 1, false, ""},
};

void CheckShared(const ActorCriticOptions& options) {
  CHECK(options.observation_size == 11);
  CHECK(options.action_size == 3);
  CHECK(options.hidden == std::vector<int>{32, 32, 32});
  CHECK(options.batch_max == 48);
  CHECK(options.actor_learning_rate == 0.25);
  CHECK(options.critic_learning_rate == 0.25);
  CHECK(options.gamma == 0.5);
  CHECK(options.tau == 0.125);
  CHECK(options.seed == RoleSeed(5, "core"));
  CHECK(options.threads == 3);
  CHECK(options.precision == Precision::kBf16);
}

TEST_CASE("a learner's hyperparameters reach its core under their standard names") {
  const LearnerContext context = ContextOf(kTable);
  const SacOptions sac = SacOptionsOf(context, 11);
  CheckShared(sac);
  CHECK(sac.alpha_learning_rate == 0.25);
  CHECK(sac.initial_alpha == 0.75);
  CHECK(sac.target_entropy == -7.0);
  const Td3Options td3 = Td3OptionsOf(context, 11);
  CheckShared(td3);
  CHECK(td3.policy_noise == 0.375);
  CHECK(td3.noise_clip == 0.625);
  CHECK(td3.policy_frequency == 4);
  CHECK(td3.bc_alpha == 0.875);
}

TEST_CASE("what a learner's table lacks keeps the core's default") {
  const LearnerContext context = ContextOf({});
  const SacOptions sac = SacOptionsOf(context, 11);
  CHECK(sac.hidden == SacOptions().hidden);
  CHECK(sac.batch_max == SacOptions().batch_max);
  CHECK(sac.alpha_learning_rate == SacOptions().alpha_learning_rate);
  CHECK_FALSE(sac.target_entropy);                  // the core then takes -action_size
  CHECK_FALSE(Td3OptionsOf(context, 11).bc_alpha);  // TD3 without cloning
  CHECK(context.hyperparameters.NumberOr("lanes", 1) == 1);
}

}  // namespace
}  // namespace b4mrl
