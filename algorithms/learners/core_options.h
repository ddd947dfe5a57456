// Hyperparameters that several learners share, and the core options made from them. A name means
// the same in every learner's table; where a table lacks a name, the core's default holds.
//
//   all cores   batch-size, hidden-width, hidden-layers, learning-rate, gamma, tau
//   SAC         initial-alpha, target-entropy
//   TD3         policy-noise, noise-clip, policy-frequency, bc-alpha
#pragma once

#include "algorithms/base/learner.h"
#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"

namespace b4mrl {

// Rows for a learner's table. `source`: who chose the defaults.
HyperparameterTable NetworkRows(std::string_view source);      // batch, layers, learning rate
HyperparameterTable ActorCriticRows(std::string_view source);  // NetworkRows, gamma and tau
HyperparameterTable Td3Rows(std::string_view source);          // ActorCriticRows, and TD3's own
// Hyperparameters of a ReplayCollector: lanes, replay-capacity.
HyperparameterTable ReplayRows(std::string_view source);
Hyperparameter InitialAlphaRow(std::string_view source);
Hyperparameter NormaliseRow(std::string_view source);

// `observation_size`: length of the policy's input, which stacks all observations of a history.
SacOptions SacOptionsOf(const LearnerContext& context, int observation_size);
Td3Options Td3OptionsOf(const LearnerContext& context, int observation_size);
// Set the hyperparameters above in the options of a core that extends these option types.
void SetActorCriticOptions(const LearnerContext& context, int observation_size,
                           ActorCriticOptions& options);
void SetSacOptions(const LearnerContext& context, int observation_size, SacOptions& options);

}  // namespace b4mrl
