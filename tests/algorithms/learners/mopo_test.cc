// MOPO as a learner: what its batches are made of. A fake daemon serves its dataset.
#include <catch2/catch.hpp>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/policy/inference.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

// A dataset of healthy walkers that get this reward in every step.
constexpr float kReward = 100;
bool ServeWalkers(FakeServer& server, const FakeCall& call) {
  if (!call.request.has_sample()) return false;
  FakeDaemon::AnswerRows(server, call, FakeDaemon::RowsOf(call.request.sample()), [](uint64_t) {
    return FakeRow{0.9f, 0.1f, kReward, 0.9f};
  });
  return true;
}

// A learner whose model is as good as untrained: its rewards are near 0, and its walkers fall soon.
class SmallMopo {
 public:
  explicit SmallMopo(const std::map<std::string_view, double>& changes)
      : daemon_(ServeWalkers), client_(Connect(daemon_)) {
    context_ = FakeContext(client_, folder_.path(), AlgorithmOf("mopo").hyperparameters);
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

  std::unique_ptr<Learner> Create() { return Take(AlgorithmOf("mopo").create(context_)); }
  std::string File(const std::string& name) const { return folder_.File(name); }

 private:
  static Client Connect(FakeDaemon& daemon) {
    daemon.dataset_environment = "Walker2d";
    return Take(Client::Connect(daemon.address()));
  }

  TemporaryFolder folder_;
  FakeDaemon daemon_;
  Client client_;
  LearnerContext context_;
};

// Of `updates` updates.
std::map<std::string, double> Update(Learner& learner, int updates) {
  MetricMeans metrics;
  for (int i = 0; i < updates; ++i) RequireOk(learner.Update(metrics));
  std::map<std::string, double> values;
  for (const Metric& metric : metrics.Take()) values[metric.name] = metric.value;
  return values;
}

}  // namespace

TEST_CASE("A batch of MOPO's has as many rows of the dataset as its real-ratio says") {
  const double real_ratio = GENERATE(0.0, 0.25, 0.75);
  // Without a discount a target is its row's reward.
  SmallMopo mopo({{"real-ratio", real_ratio}, {"gamma", 0}, {"penalty", 0}});
  const std::unique_ptr<Learner> learner = mopo.Create();
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  // The model's rewards are a few tenths, its noise at most 1.3 a row; a row more or less of the
  // dataset's would be 100 / 64.
  CHECK(Update(*learner, 1)["mean_target"] == Approx(kReward * real_ratio).margin(0.7));
}

TEST_CASE(
    "Rollouts of cycles before the last ones are forgotten, though rows that end leave room") {
  SmallMopo mopo({{"horizon", 3}, {"real-ratio", 0}});
  const std::unique_ptr<Learner> straight = mopo.Create();
  Progress quiet(true);
  RequireOk(straight->Prepare(quiet));
  // One update into the second cycle.
  CHECK(Update(*straight, 4)["rollout_terminated_rows"] > 10);

  // A checkpoint names the cycles that are kept, so who reads it has those rollouts alone.
  CheckpointWriter writer = Take(CheckpointWriter::Create(mopo.File("checkpoint.h5")));
  RequireOk(straight->Save(writer));
  RequireOk(writer.Commit());
  const std::unique_ptr<Learner> resumed = mopo.Create();
  CheckpointReader reader = Take(CheckpointReader::Open(mopo.File("checkpoint.h5")));
  RequireOk(resumed->Load(reader));
  CHECK(Update(*straight, 1) == Update(*resumed, 1));
  CHECK(FlattenPolicy(straight->Policy()) == FlattenPolicy(resumed->Policy()));
}

}  // namespace b4mrl
