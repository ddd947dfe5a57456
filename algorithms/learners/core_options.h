// A core's options from a learner's hyperparameters. Names mean the same in every learner's table;
// where a table lacks one, the core's own default holds.
//
//   all cores   hidden-width, batch-size, learning-rate, gamma, tau
//   SAC         initial-alpha, target-entropy
//   TD3         policy-noise, noise-clip, policy-frequency, bc-alpha
#pragma once

#include "algorithms/base/learner.h"
#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"

namespace b4mrl {

// `observation_size`: what the policy sees, all observations of a history together.
SacOptions SacOptionsOf(const LearnerContext& context, int observation_size);
Td3Options Td3OptionsOf(const LearnerContext& context, int observation_size);
// The parts that cores share, for the options of another one.
void SetActorCriticOptions(const LearnerContext& context, int observation_size,
                           ActorCriticOptions& options);
void SetSacOptions(const LearnerContext& context, int observation_size, SacOptions& options);

}  // namespace b4mrl
