// H2O's turns in the simulator, against a real daemon.
#include <algorithm>
#include <catch2/catch.hpp>
#include <functional>
#include <initializer_list>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "algorithms/experience/batch_buffer.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

LearnerContext ContextOf(TestDaemon& daemon) {
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.simulator = {{"gravity", ""}};
  context.seed = 7;
  context.folder = daemon.folder("");
  context.hyperparameters = Hyperparameters(AlgorithmOf("h2o").hyperparameters);
  RequireOk(context.hyperparameters.Set("hidden-width", 8));
  RequireOk(context.hyperparameters.Set("steps-per-cycle", 30));
  RequireOk(context.hyperparameters.Set("updates-per-cycle", 5));
  return context;
}

// What each of the first updates of a small learner says when row i of each of its batches of D,
// which hold the critics' four rows and then the discriminators' six, is `row(i)`.
std::vector<std::map<std::string, double>> Updates(const std::function<FakeRow(uint64_t)>& row,
                                                   int updates, double gamma) {
  FakeDaemon daemon([&](FakeServer& server, FakeCall& call) {
    if (!call.request.has_sample()) return false;
    const pb::SampleRequest& sample = call.request.sample();
    FakeDaemon::AnswerRows(server, call, FakeDaemon::RowsOf(sample),
                           [&](uint64_t i) { return row(i % sample.rows()); });
    return true;
  });
  daemon.dataset_environment = "HalfCheetah";
  Client client = Take(Client::Connect(daemon.address()));
  const TemporaryFolder folder;
  LearnerContext context = FakeContext(client, folder.path(), AlgorithmOf("h2o").hyperparameters);
  for (const auto& [name, value] :
       std::initializer_list<std::pair<std::string_view, double>>{{"hidden-width", 8},
                                                                  {"steps-per-cycle", 10},
                                                                  {"batch-size", 8},
                                                                  {"real-ratio", 0.5},
                                                                  {"discriminator-batch", 6},
                                                                  {"gap-samples", 2},
                                                                  {"gamma", gamma}}) {
    RequireOk(context.hyperparameters.Set(name, value));
  }
  const auto learner = Take(AlgorithmOf("h2o").create(context));
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  std::vector<std::map<std::string, double>> all;
  for (int i = 0; i < updates; ++i) {
    MetricMeans metrics;
    RequireOk(learner->Update(metrics));
    std::map<std::string, double>& values = all.emplace_back();
    for (const Metric& metric : metrics.Row()) values[metric.name] = metric.value;
  }
  return all;
}

std::map<std::string, double> FirstUpdate(const std::function<FakeRow(uint64_t)>& row) {
  return Updates(row, 1, /*gamma=*/0.99).front();
}

// Trains and returns the number of simulator steps after each update.
std::vector<uint64_t> StepsAfterUpdates(Learner& learner, int updates) {
  Progress quiet(true);
  RequireOk(learner.Prepare(quiet));
  std::vector<uint64_t> steps;
  for (int i = 0; i < updates; ++i) {
    MetricMeans metrics;
    RequireOk(learner.Update(metrics));
    CHECK_FALSE(metrics.first_nonfinite());
    steps.push_back(learner.environment_steps());
  }
  return steps;
}

}  // namespace

TEST_CASE("H2O goes into the simulator before the first update of each cycle") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  LearnerContext context = ContextOf(daemon);
  // Steps of a cycle are those of all lanes together.
  RequireOk(context.hyperparameters.Set("lanes", GENERATE(1, 3)));
  const auto learner = Take(AlgorithmOf("h2o").create(context));
  CHECK(StepsAfterUpdates(*learner, 7) == std::vector<uint64_t>{30, 30, 30, 30, 30, 60, 60});
}

TEST_CASE("H2O's policy sees what its dataset shows, whatever the simulator would") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  LearnerContext context = ContextOf(daemon);
  context.corruption = {{"hidden", "9"}};
  const auto learner = Take(AlgorithmOf("h2o").create(context));
  StepsAfterUpdates(*learner, 1);
  std::vector<float> expected(17, 1.0f);
  expected[9] = 0;
  CHECK(learner->Policy().observation_mask == expected);
}

TEST_CASE("H2O's discriminators and its critics see rows of their own") {
  const auto first_update = [](float critics, float discriminators) {
    return FirstUpdate([=](uint64_t i) {
      const float x = i < 4 ? critics : discriminators;
      return FakeRow{x, 0.1f, x, x};
    });
  };
  auto original = first_update(0.5f, 0.5f);
  auto other_for_critics = first_update(1, 0.5f);
  auto other_for_discriminators = first_update(0.5f, 1);
  CHECK(other_for_critics["critic_loss_real"] != original["critic_loss_real"]);
  CHECK(other_for_discriminators["critic_loss_real"] == original["critic_loss_real"]);
  for (const char* loss : {"d_sa_loss", "d_sas_loss"}) {
    CHECK(other_for_critics[loss] == original[loss]);
    CHECK(other_for_discriminators[loss] != original[loss]);
  }
}

TEST_CASE("H2O draws other simulated rows in every update") {
  const auto row = [](uint64_t) { return FakeRow{0.5f, 0.1f, 0.5f, 0.5f}; };
  // Updates of one cycle. Without a discount a target is its row's reward, whatever the networks
  // learn, and the daemon's steps have ten different ones.
  std::set<double> targets;
  for (auto& update : Updates(row, 5, /*gamma=*/0)) targets.insert(update["mean_target"]);
  CHECK(targets.size() > 1);
}

TEST_CASE("H2O takes a dataset's actions beyond the bounds for the bounds") {
  const auto first_update = [](float action) {
    return FirstUpdate([=](uint64_t) { return FakeRow{0.5f, action, 0.5f, 0.5f}; });
  };
  // The bounds are 0.25 and 2.5.
  auto within = first_update(0.1f), beyond = first_update(3), farther = first_update(4);
  for (const char* loss : {"critic_loss_real", "d_sa_loss", "d_sas_loss"}) {
    CHECK(beyond[loss] != within[loss]);
    CHECK(beyond[loss] == farther[loss]);
  }
}

TEST_CASE("Actions beyond the bounds are clipped in the columns asked for, and there alone") {
  BatchBuffer batch(1, 2, 3);
  std::ranges::fill(batch.actions.values(), -1.5f);
  batch.actions.view()(1, 0) = 0.5f;
  batch.ClipActions(2);
  CHECK(batch.actions.view()(0, 0) == -1);
  CHECK(batch.actions.view()(1, 0) == 0.5f);
  CHECK(batch.actions.view()(1, 1) == -1);
  CHECK(batch.actions.view()(0, 2) == -1.5f);
}

TEST_CASE("H2O refuses batches of real or of simulated rows alone") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 50);
  LearnerContext context = ContextOf(daemon);
  for (const double ratio : {0.0, 1.0}) {
    RequireOk(context.hyperparameters.Set("real-ratio", ratio));
    const Status status = AlgorithmOf("h2o").create(context).status();
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK(status.message().find("real-ratio") != std::string::npos);
  }
}

}  // namespace b4mrl
