// What several tests of learners begin with.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "algorithms/list.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "tests/algorithms/test_daemon.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {

inline const Algorithm& AlgorithmOf(std::string_view name) { return *Take(FindAlgorithm(name)); }

inline LearnerContext CheetahContext(TestDaemon& daemon, const std::string& dataset = "") {
  LearnerContext context;
  context.client = &daemon.client();
  context.environment = Take(daemon.client().FindEnvironment("HalfCheetah"));
  context.dataset = dataset;
  return context;
}

// For a FakeDaemon whose dataset_environment is HalfCheetah. No two of its action's dimensions have
// the same bounds, and none has [-1, 1].
inline constexpr float kFakeActionScale[] = {0.25f, 2.5f};
inline LearnerContext FakeContext(Client& client, const std::string& folder,
                                  std::span<const Hyperparameter> table) {
  LearnerContext context;
  context.client = &client;
  context.environment.name = "HalfCheetah";  // whose episodes have no end that a state tells
  context.environment.termination.emplace();
  context.environment.observation.dimensions.resize(kObservationSize);
  for (const float scale : kFakeActionScale) {
    context.environment.action.dimensions.push_back({"", "", -scale, scale, ""});
  }
  context.folder = folder;
  context.hyperparameters = Hyperparameters(table);
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
