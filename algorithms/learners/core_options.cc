#include "algorithms/learners/core_options.h"

namespace b4mrl {
namespace {

// Writes the value of `name` to `out`; leaves `out` unchanged if the table lacks `name`.
template <typename Number>
void Read(const Hyperparameters& values, std::string_view name, Number& out) {
  if (values.Find(name) != nullptr) out = static_cast<Number>(values.Number(name));
}

void Read(const Hyperparameters& values, std::string_view name, std::optional<double>& out) {
  if (values.Find(name) != nullptr) out = values.Number(name);
}

}  // namespace

HyperparameterTable NetworkRows(std::string_view source) {
  return {
      Whole("batch-size", 256, {1, 65'536}, "transitions in the batch of one gradient step",
            {.unit = "transitions", .source = source}),
      Whole("hidden-width", 256, {1, 2048},
            "units in each hidden layer of every policy, value and discriminator network",
            {.unit = "units", .source = source}),
      Whole("hidden-layers", 2, {1, 8},
            "hidden layers of every policy, value and discriminator network",
            {.unit = "layers", .source = source}),
      Real("learning-rate", 3e-4, {1e-8, 1},
           "Adam's learning rate for the policy and all that is trained together with it",
           {.source = source}),
  };
}

HyperparameterTable ActorCriticRows(std::string_view source) {
  const HyperparameterTable own = {
      Real("gamma", 0.99, {0, 1}, "discount factor of the return", {.source = source}),
      Real("tau", 0.005, {0, 1},
           "Polyak rate of the target networks: target <- tau online + (1 - tau) target",
           {.source = source}),
  };
  return NetworkRows(source) + own;
}

HyperparameterTable Td3Rows(std::string_view source) {
  const HyperparameterTable own = {
      Real("policy-noise", 0.2, {0, 10},
           "standard deviation of the noise on the target policy's actions",
           {.unit = "half the action range", .source = source}),
      Real("noise-clip", 0.5, {0, 10},
           "largest magnitude of the noise on the target policy's actions",
           {.unit = "half the action range", .source = source}),
      Whole("policy-frequency", 2, {1, 1000},
            "updates of the critics for each update of the actor and of the targets",
            {.unit = "updates", .source = source}),
  };
  return ActorCriticRows(source) + own;
}

HyperparameterTable ReplayRows(std::string_view source) {
  return {
      Whole("lanes", 1, {1, 1024},
            "environments stepped at once; as many updates follow each step of all of them",
            {.unit = "environments", .source = source}),
      Whole("replay-capacity", 1e6, {1, 1e9},
            "size of the replay buffer: batches are drawn from the newest transitions",
            {.unit = "transitions", .source = source}),
  };
}

Hyperparameter InitialAlphaRow(std::string_view source) {
  return Real("initial-alpha", 1, {1e-9, 1e3},
              "entropy weight alpha before the first update, which then adjusts it",
              {.source = source});
}

Hyperparameter NormaliseRow(std::string_view source) {
  return Switch("normalise", true,
                "whether to normalise observations: (s - mean) / (std + 0.001) over the dataset",
                source);
}

void SetActorCriticOptions(const LearnerContext& context, int observation_size,
                           ActorCriticOptions& options) {
  const Hyperparameters& values = context.hyperparameters;
  options.observation_size = observation_size;
  options.action_size = context.action_size();
  if (values.Find("hidden-layers") != nullptr) {
    options.hidden.assign(values.Unsigned("hidden-layers"), values.Integer("hidden-width"));
  }
  Read(values, "batch-size", options.batch_max);
  Read(values, "learning-rate", options.actor_learning_rate);
  Read(values, "learning-rate", options.critic_learning_rate);
  Read(values, "gamma", options.gamma);
  Read(values, "tau", options.tau);
  options.seed = RoleSeed(context.seed, "core");
  options.threads = static_cast<int>(context.threads);
  options.precision = context.precision;
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
