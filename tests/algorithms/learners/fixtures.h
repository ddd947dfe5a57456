// What several tests of learners begin with.
#pragma once

#include <string>

#include "algorithms/learner.h"
#include "algorithms/rl/dynamics_ensemble.h"
#include "tests/algorithms/learners/test_daemon.h"

namespace b4mrl {

inline LearnerContext CheetahContext(TestDaemon& daemon, const std::string& dataset = "") {
  LearnerContext context;
  context.client = &daemon.client();
  context.environment = Take(daemon.client().FindEnvironment("HalfCheetah"));
  context.dataset = dataset;
  return context;
}

// Of HalfCheetah's sizes, untrained.
inline DynamicsEnsembleOptions SmallEnsembleOptions() {
  DynamicsEnsembleOptions options;
  options.observation_size = 17;
  options.action_size = 6;
  options.members = 3;
  options.elites = 2;
  options.hidden = {16, 16, 16, 16};
  return options;
}

}  // namespace b4mrl
