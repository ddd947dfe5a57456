// What an online learner's lanes store, against a real daemon.
#include "algorithms/experience/replay_collector.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/cores/td3_core.h"
#include "tests/algorithms/fixtures.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

constexpr int kLanes = 2;

LearnerContext ContextOf(Client& client, const std::string& folder,
                         const std::string& environment) {
  LearnerContext context;
  context.client = &client;
  context.environment = Take(client.FindEnvironment(environment));
  context.seed = 7;
  context.folder = folder;
  context.hyperparameters = Hyperparameters(AlgorithmOf("td3").hyperparameters);
  RequireOk(context.hyperparameters.Set("lanes", kLanes));
  return context;
}

LearnerContext ContextOf(TestDaemon& daemon, const std::string& environment) {
  return ContextOf(daemon.client(), daemon.folder(""), environment);
}

// Lanes of `context` that took uniform actions until they had `transitions`.
ReplayCollector WarmLanes(const LearnerContext& context, uint64_t transitions) {
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  Progress quiet(true);
  RequireOk(lanes.WarmUp(transitions, quiet));
  return lanes;
}

FixedOrderPolicy RandomPolicy(const ReplayCollector& lanes, int action_size) {
  Td3Options options;
  options.observation_size = lanes.observation_size();
  options.action_size = action_size;
  options.hidden = {16, 16};
  return Take(FixedOrderPolicy::Create(Take(Td3Core<float>::Create(options)).Policy()));
}

// Every transition that one lane took, in order: column i is its i-th.
BatchBuffer TransitionsOf(const ReplayCollector& lanes, int lane, int action_size) {
  const auto steps = static_cast<int>(lanes.replay().length()) / kLanes;
  BatchBuffer rows(lanes.observation_size(), action_size, steps);
  for (int i = 0; i < steps; ++i) {
    lanes.replay().Get(static_cast<uint64_t>(i) * kLanes + lane, i, rows);
  }
  return rows;
}

// Whether transition `to` starts where transition `from` ended.
bool LeadsTo(const BatchBuffer& rows, int from, int to) {
  const float* next = rows.next_observations.view().column(from);
  const int size = rows.observations.rows();
  return std::equal(next, next + size, rows.observations.view().column(to));
}

// Returns of the episodes that began in step `first` or later and ended by a fall.
std::vector<double> ReturnsOf(const BatchBuffer& rows, int first) {
  std::vector<double> returns;
  double episode_return = 0;
  int began = 0;
  for (int step = 0; step < rows.size(); ++step) {
    episode_return += rows.rewards[step];
    if (rows.not_terminated[step] != 0) continue;
    if (began >= first) returns.push_back(episode_return);
    episode_return = 0;
    began = step + 1;
  }
  return returns;
}

double Mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

bool LeadsToNext(const BatchBuffer& rows, int step) { return LeadsTo(rows, step, step + 1); }

}  // namespace

TEST_CASE("An episode that ends by the step limit bootstraps from the observation it ended in") {
  TestDaemon daemon;
  const LearnerContext context = ContextOf(daemon, "HalfCheetah");
  const ReplayCollector lanes = WarmLanes(context, 1002 * kLanes);
  CHECK(lanes.environment_steps() == 1002 * kLanes);
  for (int lane = 0; lane < kLanes; ++lane) {
    const BatchBuffer rows = TransitionsOf(lanes, lane, context.action_size());
    for (int step = 0; step < 1001; ++step) {
      INFO(step);
      CHECK(rows.not_terminated[step] == 1);
      // Step 999 is the last of the episode; what follows it starts from the reset.
      CHECK(LeadsToNext(rows, step) == (step != 999));
    }
    // A step moves the body by centimetres; the reset puts it back up.
    const float* last = rows.observations.view().column(999);
    const float* final = rows.next_observations.view().column(999);
    CHECK(std::abs(final[1] - last[1]) < 1);
  }
}

TEST_CASE("Actions of the warm-up are uniform in [-1, 1], and new ones in every step and lane") {
  TestDaemon daemon;
  const LearnerContext context = ContextOf(daemon, "HalfCheetah");
  constexpr int kSteps = 300;
  const ReplayCollector lanes = WarmLanes(context, kSteps * kLanes);
  double sum = 0, squares = 0;
  std::set<std::vector<float>> different;
  for (int lane = 0; lane < kLanes; ++lane) {
    const BatchBuffer rows = TransitionsOf(lanes, lane, context.action_size());
    for (int step = 0; step < kSteps; ++step) {
      const float* action = rows.actions.view().column(step);
      different.emplace(action, action + rows.actions.rows());
    }
    for (const float action : rows.actions.values()) {
      REQUIRE(std::abs(action) <= 1);
      sum += action;
      squares += action * action;
    }
  }
  CHECK(different.size() == kSteps * kLanes);
  // A draw has the variance 1/3, and its square the mean 1/3 and the variance 1/5 - 1/9; five
  // deviations of the means.
  const double count = kSteps * kLanes * context.action_size();
  CHECK(sum / count == Approx(0).margin(5 / std::sqrt(3 * count)));
  CHECK(squares / count == Approx(1.0 / 3).margin(5 * std::sqrt(4.0 / 45 / count)));
}

TEST_CASE("A fall is stored as terminated, and returns are those of whole episodes") {
  TestDaemon daemon;
  const LearnerContext context = ContextOf(daemon, "Hopper");
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  const FixedOrderPolicy policy = RandomPolicy(lanes, context.action_size());
  MetricMeans metrics;
  for (int step = 0; step < 400; ++step) RequireOk(lanes.Step(policy, metrics));

  std::vector<double> returns;
  for (int lane = 0; lane < kLanes; ++lane) {
    const BatchBuffer rows = TransitionsOf(lanes, lane, context.action_size());
    for (int step = 0; step + 1 < rows.size(); ++step) {
      const bool fell = rows.not_terminated[step] == 0;
      INFO(step);
      CHECK(LeadsToNext(rows, step) == !fell);
    }
    const std::vector<double> of_lane = ReturnsOf(rows, 0);
    returns.insert(returns.end(), of_lane.begin(), of_lane.end());
  }
  REQUIRE(returns.size() > 5);
  const MetricRow row = metrics.Row();
  REQUIRE(row.size() == 1);
  CHECK(row[0].name == "episodic_return");
  // The replay file rounds each of a few dozen rewards to float.
  CHECK(row[0].value == Approx(Mean(returns)).epsilon(1e-5));
}

TEST_CASE("Returns are of episodes that began after the warm-up, in a resumed run as well") {
  TestDaemon daemon;
  const LearnerContext context = ContextOf(daemon, "Hopper");
  constexpr int kWarmUpSteps = 5;
  ReplayCollector warm = WarmLanes(context, kWarmUpSteps * kLanes);
  const bool resumed = GENERATE(false, true);
  std::optional<ReplayCollector> reloaded;
  if (resumed) {
    const std::string path = daemon.folder("checkpoint.h5");
    CheckpointWriter writer = Take(CheckpointWriter::Create(path));
    RequireOk(warm.Save(writer));
    RequireOk(writer.Commit());
    CheckpointReader reader = Take(CheckpointReader::Open(path));
    reloaded.emplace(Take(ReplayCollector::Open(context)));
    RequireOk(reloaded->Load(reader));
  }
  ReplayCollector& lanes = resumed ? *reloaded : warm;
  const FixedOrderPolicy policy = RandomPolicy(lanes, context.action_size());
  MetricMeans metrics;
  for (int step = 0; step < 100; ++step) RequireOk(lanes.Step(policy, metrics));

  std::vector<double> returns;
  for (int lane = 0; lane < kLanes; ++lane) {
    const BatchBuffer rows = TransitionsOf(lanes, lane, context.action_size());
    const std::vector<double> of_lane = ReturnsOf(rows, kWarmUpSteps);
    // The episode that the warm-up began is left out, and no other.
    REQUIRE(ReturnsOf(rows, 0).size() == of_lane.size() + 1);
    returns.insert(returns.end(), of_lane.begin(), of_lane.end());
  }
  REQUIRE(returns.size() > 1);
  // The replay file rounds each of a few dozen rewards to float.
  CHECK(metrics.Row()[0].value == Approx(Mean(returns)).epsilon(1e-5));
}

TEST_CASE("Transitions hold the last observations, oldest first, and forget another episode's") {
  TestDaemon daemon;
  LearnerContext context = ContextOf(daemon, "Hopper");
  context.history_length = 3;
  const int size = context.observation_size();
  const ReplayCollector lanes = WarmLanes(context, 200 * kLanes);
  REQUIRE(lanes.observation_size() == 3 * size);
  const BatchBuffer rows = TransitionsOf(lanes, 1, context.action_size());
  bool first = true;  // of an episode
  int resets = 0;
  for (int step = 0; step < rows.size(); ++step) {
    INFO(step);
    const float* now = rows.observations.view().column(step);
    const float* next = rows.next_observations.view().column(step);
    CHECK(std::equal(now + size, now + 3 * size, next));
    if (first) {
      CHECK(std::equal(now, now + 2 * size, now + size));  // the first one in all places
      ++resets;
    }
    first = rows.not_terminated[step] == 0;
  }
  CHECK(resets > 3);
}

TEST_CASE("Hidden dimensions are zero in what lanes store, and the policy's mask names them") {
  TestDaemon daemon;
  LearnerContext context = ContextOf(daemon, "HalfCheetah");
  context.history_length = 2;
  std::vector<float> mask(17, 1);
  mask[3] = mask[9] = 0;
  // Hidden by the simulator, and by a mask that a hybrid learner takes from its dataset.
  const bool by_simulator = GENERATE(true, false);
  if (by_simulator) context.simulator = {{"hidden", "3+9"}};
  const std::optional<std::vector<float>> given = by_simulator ? std::nullopt : std::optional(mask);
  ReplayCollector lanes = Take(ReplayCollector::Open(context, given));
  RequireOk(lanes.Start());
  Progress quiet(true);
  RequireOk(lanes.WarmUp(20 * kLanes, quiet));

  std::vector<float> stacked = mask;
  stacked.insert(stacked.end(), mask.begin(), mask.end());
  CHECK(lanes.WithInputs({}).observation_mask == stacked);
  const BatchBuffer rows = TransitionsOf(lanes, 0, context.action_size());
  for (int step = 0; step < rows.size(); ++step) {
    for (int i = 0; i < lanes.observation_size(); ++i) {
      INFO(step << ", dimension " << i);
      CHECK((rows.next_observations.view()(i, step) == 0) == (stacked[i] == 0));
    }
  }
}

TEST_CASE("Exploration adds noise of the given deviation to a deterministic policy's action") {
  TestDaemon daemon;
  LearnerContext context = ContextOf(daemon, "HalfCheetah");
  const double deviation = GENERATE(0.0, 0.1, 5.0);
  RequireOk(context.hyperparameters.Set("exploration-noise", deviation));
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  const FixedOrderPolicy policy = RandomPolicy(lanes, context.action_size());
  MetricMeans metrics;
  constexpr int kSteps = 300;
  for (int step = 0; step < kSteps; ++step) RequireOk(lanes.Step(policy, metrics));
  // No episode has ended yet: the name has its column in the log, and no value.
  const MetricRow row = metrics.Row();
  REQUIRE(row.size() == 1);
  CHECK(row[0].name == "episodic_return");
  CHECK(std::isnan(row[0].value));

  const BatchBuffer rows = TransitionsOf(lanes, 0, context.action_size());
  MatrixBuffer<float> expected(context.action_size(), kSteps);
  policy.Act(rows.observations.view(), expected.view());
  double squares = 0;
  int at_a_bound = 0;
  for (size_t i = 0; i < expected.values().size(); ++i) {
    const float action = rows.actions.values()[i];
    REQUIRE(std::abs(action) <= 1);
    squares += std::pow(action - expected.values()[i], 2);
    at_a_bound += std::abs(action) == 1 ? 1 : 0;
  }
  const double count = static_cast<double>(expected.values().size());
  if (deviation == 0.0) CHECK(squares == 0);
  // 1,800 draws: the deviation's own deviation is 0.1 / sqrt(3600); five of those.
  if (deviation == 0.1) CHECK(std::sqrt(squares / count) == Approx(0.1).margin(0.0085));
  // Most of N(0, 5) lies beyond both bounds.
  if (deviation == 5.0) CHECK(at_a_bound > 0.7 * count);
}

TEST_CASE("A step that the daemon gave up is not stored, and its lane goes on") {
  TemporaryFolder folder;
  PrivateDaemonOptions options;
  options.binary = B4MRL_BINARY_DIR "/b4mrl-serve-faulty";
  options.data_folder = folder.path();
  options.environment = {"B4MRL_FAULT=crash:1:12"};  // the twelfth operation of lane 1
  const PrivateDaemon daemon = Take(PrivateDaemon::Start(options));
  Client client = Take(Client::Connect(daemon.endpoint()));
  const LearnerContext context = ContextOf(client, folder.path(), "HalfCheetah");
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  const FixedOrderPolicy policy = RandomPolicy(lanes, context.action_size());
  MetricMeans metrics;
  for (int step = 0; step < 30; ++step) RequireOk(lanes.Step(policy, metrics));
  CHECK(lanes.environment_steps() == 60);
  REQUIRE(lanes.replay().length() == 59);
  // No stored step leads from the lane's broken episode to its next one.
  BatchBuffer rows(lanes.observation_size(), context.action_size(), 59);
  for (int i = 0; i < 59; ++i) lanes.replay().Get(static_cast<uint64_t>(i), i, rows);
  int continued = 0;  // transitions whose end is the start of another
  for (int i = 0; i < 59; ++i) {
    const bool with_both = i + 2 < 59 && LeadsTo(rows, i, i + 2);
    const bool beside_the_gap = i + 1 < 59 && LeadsTo(rows, i, i + 1);
    continued += with_both || beside_the_gap ? 1 : 0;
  }
  CHECK(continued == 59 - 3);  // all but the last of either lane and the one before the gap
}

TEST_CASE("A step of several lanes is followed by as many updates") {
  TestDaemon daemon;
  LearnerContext context = ContextOf(daemon, "HalfCheetah");
  const auto set = [&](std::string_view name, double value) {
    RequireOk(context.hyperparameters.Set(name, value));
  };
  set("lanes", 4);
  set("warm-up", 10);
  set("batch-size", 8);
  set("hidden-width", 8);
  const std::unique_ptr<Learner> learner = Take(AlgorithmOf("td3").create(context));
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  CHECK(learner->environment_steps() == 12);  // transitions come four at a time
  MetricMeans metrics;
  for (uint64_t update = 0; update < 9; ++update) {
    RequireOk(learner->Update(metrics));
    CHECK(learner->environment_steps() == 12 + 4 * (update / 4 + 1));
  }
}

}  // namespace b4mrl
