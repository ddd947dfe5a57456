// A small MOPO or HyMOPO on a fake daemon's dataset. For tests.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {

// Of walkers that are healthy and get this reward in every step.
inline constexpr float kWalkersReward = 100;
inline bool ServeWalkers(FakeServer& server, const FakeCall& call) {
  if (!call.request.has_sample()) return false;
  FakeDaemon::AnswerRows(server, call, FakeDaemon::RowsOf(call.request.sample()), [](uint64_t) {
    return FakeRow{0.9f, 0.1f, kWalkersReward, 0.9f};
  });
  return true;
}

// Its model is as good as untrained: rewards are near 0, and walkers fall soon. A walker is healthy
// while observation 0 lies in (0.8, 2) and observation 1 in (-1, 1).
class SmallModelBased {
 public:
  // `changes`: of hyperparameters. `hidden`: dimensions that the dataset hides.
  SmallModelBased(std::string_view algorithm, const std::map<std::string_view, double>& changes,
                  std::vector<uint32_t> hidden = {}, FakeDaemon::Hook hook = ServeWalkers)
      : algorithm_(AlgorithmOf(algorithm)),
        daemon_(std::move(hook)),
        client_(Connect(daemon_, std::move(hidden))),
        context_(FakeContext(client_, folder_.path(), algorithm_.hyperparameters)) {
    context_.environment.name = "Walker2d";
    context_.environment.termination = std::vector<DimensionBounds>{{0, 0.8, 2}, {1, -1, 1}};
    std::map<std::string_view, double> values = {
        {"hidden-width", 8},     {"batch-size", 64},          {"rollout-rows", 50},
        {"rollout-every", 3},    {"model-retain", 1},         {"ensemble-width", 8},
        {"ensemble-members", 2}, {"ensemble-elites", 1},      {"ensemble-batch-size", 32},
        {"ensemble-cache", 0},   {"ensemble-max-updates", 1}, {"ensemble-learning-rate", 1e-8},
    };
    for (const auto& [name, value] : changes) values[name] = value;
    for (const auto& [name, value] : values) RequireOk(context_.hyperparameters.Set(name, value));
  }

  LearnerContext& context() { return context_; }
  std::unique_ptr<Learner> Create() { return Take(algorithm_.create(context_)); }
  std::unique_ptr<Learner> CreatePrepared() {
    std::unique_ptr<Learner> learner = Create();
    Progress quiet(true);
    RequireOk(learner->Prepare(quiet));
    return learner;
  }
  std::string File(const std::string& name) const { return folder_.File(name); }

 private:
  static Client Connect(FakeDaemon& daemon, std::vector<uint32_t> hidden) {
    daemon.dataset_environment = "Walker2d";
    daemon.hidden_dimensions = std::move(hidden);
    return Take(Client::Connect(daemon.address()));
  }

  const Algorithm& algorithm_;
  TemporaryFolder folder_;
  FakeDaemon daemon_;
  Client client_;
  LearnerContext context_;
};

// The means of the metrics of `updates` updates.
inline std::map<std::string, double> Update(Learner& learner, int updates) {
  MetricMeans metrics;
  for (int i = 0; i < updates; ++i) RequireOk(learner.Update(metrics));
  std::map<std::string, double> values;
  for (const Metric& metric : metrics.Row()) values[metric.name] = metric.value;
  return values;
}

}  // namespace b4mrl
