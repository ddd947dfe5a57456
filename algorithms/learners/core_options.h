// The hyperparameters that several learners' tables share, and the options of a core that they
// become. Names mean the same in every table; where a table lacks one, the core's default holds.
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

// Rows of a table. `source`: who chose the defaults.
HyperparameterTable NetworkRows(std::string_view source);      // batch, layers, learning rate
HyperparameterTable ActorCriticRows(std::string_view source);  // the same, gamma and tau
HyperparameterTable Td3Rows(std::string_view source);          // the same, and TD3's own
// Where an online learner acts and what it keeps: lanes, replay-capacity.
HyperparameterTable ReplayRows(std::string_view source);
Hyperparameter InitialAlphaRow(std::string_view source);
Hyperparameter NormaliseRow(std::string_view source);

// `observation_size`: of the policy's input, all observations of a history together.
SacOptions SacOptionsOf(const LearnerContext& context, int observation_size);
Td3Options Td3OptionsOf(const LearnerContext& context, int observation_size);
// The options that cores share, for another core's.
void SetActorCriticOptions(const LearnerContext& context, int observation_size,
                           ActorCriticOptions& options);
void SetSacOptions(const LearnerContext& context, int observation_size, SacOptions& options);

}  // namespace b4mrl
