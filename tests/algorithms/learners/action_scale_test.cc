// Learners work with actions in [-1, 1], daemons and datasets with the environment's. Every place
// where one becomes the other, with bounds that differ from 1 and from one another: a fake daemon's
// 0.25 and 2.5.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <mutex>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "algorithms/experience/offline_batches.h"
#include "algorithms/experience/replay_collector.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/experience/training_simulator.h"
#include "algorithms/model/model_data.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/policy/agent_policy.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

constexpr int kObservation = static_cast<int>(kObservationSize);
constexpr int kAction = static_cast<int>(kActionSize);

// A fake daemon that keeps the actions it is sent, and a client of it.
class RecordingDaemon {
 public:
  RecordingDaemon()
      : daemon_([this](FakeServer&, FakeCall& call) { return Note(call); }),
        client_(Connect(daemon_)) {}

  LearnerContext Context(std::span<const Hyperparameter> table) {
    return FakeContext(client_, folder_.File(""), table);
  }
  // Of each Step, in order.
  std::vector<std::vector<float>> steps() const {
    const std::lock_guard lock(mutex_);
    return steps_;
  }
  // Of each Query, by its draw and first row; of those that share them the first.
  using QueryId = std::pair<uint64_t, uint64_t>;
  std::map<QueryId, std::vector<float>> queries() const {
    const std::lock_guard lock(mutex_);
    return queries_;
  }

 private:
  static Client Connect(FakeDaemon& daemon) {
    daemon.dataset_environment = "HalfCheetah";
    return Take(Client::Connect(daemon.address()));
  }
  bool Note(const FakeCall& call) {
    const std::lock_guard lock(mutex_);
    if (call.request.has_step()) steps_.push_back(Elements<float>(call, "actions"));
    if (call.request.has_query()) {
      const pb::QueryRequest& query = call.request.query();
      queries_.emplace(QueryId(query.draw(), query.first_row()), Elements<float>(call, "actions"));
    }
    return false;
  }

  mutable std::mutex mutex_;
  std::vector<std::vector<float>> steps_;          // under mutex_
  std::map<QueryId, std::vector<float>> queries_;  // under mutex_
  TemporaryFolder folder_;
  FakeDaemon daemon_;  // its thread uses the members above
  Client client_;
};

// Whether `sent` (row-major) are the actions in columns [first, ...) of `rows`, in other units.
bool AreScaled(const std::vector<float>& sent, const BatchBuffer& rows, int first) {
  for (size_t i = 0; i < sent.size(); ++i) {
    const int dimension = static_cast<int>(i) % kAction, row = static_cast<int>(i) / kAction;
    const float action = rows.actions.view()(dimension, first + row);
    if (std::abs(action) > 1 || sent[i] != action * kFakeActionScale[dimension]) return false;
  }
  return !sent.empty();
}

BatchBuffer All(const ReplayBuffer& replay) {
  BatchBuffer rows(kObservation, kAction, static_cast<int>(replay.size()));
  for (int i = 0; i < rows.size(); ++i) replay.Get(static_cast<uint64_t>(i), i, rows);
  return rows;
}

PolicyWeights RandomPolicy() {
  SacOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.hidden = {8, 8};
  return Take(SacCore<float>::Create(options)).Policy();
}

// Its actions are functions of the noise alone.
PolicyWeights BlindPolicy() {
  PolicyWeights policy = RandomPolicy();
  std::ranges::fill(policy.mean.weight, 0.0f);
  std::ranges::fill(policy.log_std->weight, 0.0f);
  return policy;
}

DynamicsEnsemble<float> RandomEnsemble() {
  DynamicsEnsembleOptions options = SmallEnsembleOptions();
  options.observation_size = kObservation;
  options.action_size = kAction;
  return Take(DynamicsEnsemble<float>::Create(options));
}

}  // namespace

TEST_CASE("Lanes execute the actions they store, in the environment's units") {
  RecordingDaemon daemon;
  LearnerContext context = daemon.Context(AlgorithmOf("sac").hyperparameters);
  RequireOk(context.hyperparameters.Set("lanes", 2));
  ReplayCollector lanes = Take(ReplayCollector::Open(context));
  RequireOk(lanes.Start());
  Progress quiet(true);
  RequireOk(lanes.WarmUp(6, quiet));
  MetricMeans metrics;
  const FixedOrderPolicy policy = Take(FixedOrderPolicy::Create(RandomPolicy()));
  for (int step = 0; step < 3; ++step) RequireOk(lanes.Step(policy, metrics));
  const std::vector<std::vector<float>> steps = daemon.steps();
  REQUIRE(steps.size() == 6);
  const BatchBuffer rows = All(lanes.replay());
  for (int step = 0; step < 6; ++step) CHECK(AreScaled(steps[step], rows, 2 * step));
}

TEST_CASE("Offline batches hold a dataset's actions in [-1, 1]") {
  RecordingDaemon daemon;
  const LearnerContext context = daemon.Context(AlgorithmOf("td3-bc").hyperparameters);
  OfflineBatches batches = Take(OfflineBatches::Open(context, {.batch_size = 4}));
  batches.Start(3);  // a batch of threes
  const TransitionBatch<float> batch = Take(batches.Next());
  for (int row = 0; row < 4; ++row) {
    CHECK(batch.actions(0, row) == 3 / 0.25f);
    CHECK(batch.actions(1, row) == 3 / 2.5f);
  }
}

TEST_CASE("Rows of a dataset among others hold its actions in [-1, 1]") {
  const std::vector<float> observations(4 * kObservation), outcomes(4);
  const std::vector<float> actions = {0, 0, 0.25f, 2.5f, -0.125f, 0.5f, 0, 0};
  const std::vector<uint8_t> terminals(4);
  TransitionRows served;
  served.rows = 4;
  served.observations = served.next_observations = observations;
  served.actions = actions;
  served.rewards = outcomes;
  served.terminals = terminals;
  BatchBuffer batch(kObservation, kAction, 2);
  batch.SetRows(served, 1, 2, kFakeActionScale);
  CHECK(batch.actions.view()(0, 0) == 1);
  CHECK(batch.actions.view()(1, 0) == 1);
  CHECK(batch.actions.view()(0, 1) == -0.5f);
  CHECK(batch.actions.view()(1, 1) == 0.2f);
}

TEST_CASE("A model learns from actions in [-1, 1], and the pre-pass asks about the dataset's") {
  RecordingDaemon daemon;
  const LearnerContext context = daemon.Context(AlgorithmOf("hymopo").hyperparameters);
  const auto dataset = Take(OpenTrainingDataset(context));
  Progress quiet(true);
  const ModelData changes = Take(ReadChanges(context, *dataset, quiet));
  RemoteEnvironment simulator = Take(OpenTrainingSimulator(context, /*lanes=*/0));
  const ModelData corrections = Take(QueryCorrections(context, *dataset, simulator, 1, quiet));
  for (const ModelData* data : {&changes, &corrections}) {
    REQUIRE(data->rows == 100);
    for (int row = 0; row < 100; ++row) {  // row i is full of i
      CHECK(data->actions.view()(0, row) == static_cast<float>(row) / 0.25f);
      CHECK(data->actions.view()(1, row) == static_cast<float>(row) / 2.5f);
    }
  }
  const std::map<RecordingDaemon::QueryId, std::vector<float>> queries = daemon.queries();
  REQUIRE(queries.size() == 1);
  const std::vector<float>& asked = queries.at({0, 0});
  REQUIRE(asked.size() == 100 * kActionSize);
  for (size_t i = 0; i < asked.size(); ++i) CHECK(asked[i] == static_cast<float>(i / kActionSize));
}

TEST_CASE("Rollouts ask about the actions they store, each step of a cycle by a draw of its own") {
  RecordingDaemon daemon;
  const LearnerContext context = daemon.Context(AlgorithmOf("hymopo").hyperparameters);
  RemoteEnvironment simulator = Take(OpenTrainingSimulator(context, /*lanes=*/0));
  DynamicsEnsemble<float> ensemble = RandomEnsemble();
  ModelRolloutOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.action_scale = context.ActionScale();
  options.termination = Take(Termination::Of(context.environment));
  options.horizon = 2;
  options.chunk_rows = 20;
  ModelRollout rollout(options, &simulator, &ensemble);
  ReplayBuffer pool = Take(ReplayBuffer::InMemory({kObservation, kAction, 200}));
  for (const uint64_t cycle : {0, 1}) {
    RequireOk(rollout.Begin(cycle, std::vector<float>(30 * kObservationSize), BlindPolicy()));
    Take(rollout.Finish(pool));
  }
  const BatchBuffer rows = All(pool);
  REQUIRE(rows.size() == 2 * 2 * 30);
  const std::map<RecordingDaemon::QueryId, std::vector<float>> queries = daemon.queries();
  REQUIRE(queries.size() == 2 * 2 * 2);  // cycles, steps, chunks
  std::set<std::vector<float>> noise;    // of the first ten rows of each
  for (const auto& [id, actions] : queries) {
    noise.emplace(actions.begin(), actions.begin() + 10 * kAction);
  }
  CHECK(noise.size() == queries.size());
  for (const int cycle : {0, 1}) {
    for (const int step : {0, 1}) {
      INFO(cycle << ", " << step);
      const uint64_t draw = 1 + 2 * cycle + step;  // 0 is the pre-pass's
      const int chunk = 60 * cycle;                // within a cycle one chunk follows the other
      CHECK(AreScaled(queries.at({draw, 0}), rows, chunk + 20 * step));
      CHECK(AreScaled(queries.at({draw, 20}), rows, chunk + 40 + 10 * step));
    }
  }
}

TEST_CASE("An agent acts in the environment's units, its network in [-1, 1]") {
  const PolicyWeights weights = RandomPolicy();
  const FixedOrderPolicy network = Take(FixedOrderPolicy::Create(weights));
  const AgentPolicy policy = Take(AgentPolicy::Create(MakeAgent(weights, 1, kFakeActionScale)));
  constexpr int kColumns = 5;
  MatrixBuffer<float> observations(kObservation, kColumns), noise(kAction, kColumns);
  Rng rng(4, "action-scale-test");
  rng.FillNormal(observations.values());
  rng.FillNormal(noise.values());
  MatrixBuffer<float> inner(kAction, kColumns), outer(kAction, kColumns);
  const bool sampled = GENERATE(false, true);
  if (sampled) {
    network.Sample(observations.view(), noise.view(), inner.view());
    policy.Sample(observations.view(), noise.view(), outer.view(), {});
  } else {
    network.Act(observations.view(), inner.view());
    policy.Act(observations.view(), outer.view());
  }
  for (int column = 0; column < kColumns; ++column) {
    CHECK(inner.view()(0, column) != 0);
    for (int i = 0; i < kAction; ++i) {
      CHECK(outer.view()(i, column) == inner.view()(i, column) * kFakeActionScale[i]);
    }
  }
}

}  // namespace b4mrl
