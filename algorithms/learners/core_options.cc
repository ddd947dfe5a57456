#include "algorithms/learners/core_options.h"

namespace b4mrl {
namespace {

// Leaves `out` as it is where the table lacks the name.
template <typename Number>
void Read(const Hyperparameters& values, std::string_view name, Number& out) {
  if (values.Find(name) != nullptr) out = static_cast<Number>(values.Number(name));
}

void Read(const Hyperparameters& values, std::string_view name, std::optional<double>& out) {
  if (values.Find(name) != nullptr) out = values.Number(name);
}

}  // namespace

void SetActorCriticOptions(const LearnerContext& context, int observation_size,
                           ActorCriticOptions& options) {
  const Hyperparameters& values = context.hyperparameters;
  options.observation_size = observation_size;
  options.action_size = context.action_size();
  for (int& width : options.hidden) Read(values, "hidden-width", width);
  Read(values, "batch-size", options.batch_max);
  Read(values, "learning-rate", options.actor_learning_rate);
  Read(values, "learning-rate", options.critic_learning_rate);
  Read(values, "gamma", options.gamma);
  Read(values, "tau", options.tau);
  options.seed = RoleSeed(context.seed, "core");
  options.threads = static_cast<int>(context.threads);
}

void SetSacOptions(const LearnerContext& context, int observation_size, SacOptions& options) {
  const Hyperparameters& values = context.hyperparameters;
  SetActorCriticOptions(context, observation_size, options);
  Read(values, "learning-rate", options.alpha_learning_rate);
  Read(values, "initial-alpha", options.initial_alpha);
  Read(values, "target-entropy", options.target_entropy);
}

SacOptions SacOptionsOf(const LearnerContext& context, int observation_size) {
  SacOptions options;
  SetSacOptions(context, observation_size, options);
  return options;
}

Td3Options Td3OptionsOf(const LearnerContext& context, int observation_size) {
  const Hyperparameters& values = context.hyperparameters;
  Td3Options options;
  SetActorCriticOptions(context, observation_size, options);
  Read(values, "policy-noise", options.policy_noise);
  Read(values, "noise-clip", options.noise_clip);
  Read(values, "policy-frequency", options.policy_frequency);
  Read(values, "bc-alpha", options.bc_alpha);
  return options;
}

}  // namespace b4mrl
