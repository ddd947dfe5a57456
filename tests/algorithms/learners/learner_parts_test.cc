// The pre-pass, the rollouts, collection and evaluation against a real daemon.
#include <catch2/catch.hpp>
#include <cstring>

#include "algorithms/episodes/evaluate.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/model/model_data.h"
#include "algorithms/model/model_rollout.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

constexpr int kObservation = 17;
constexpr int kAction = 6;

LearnerContext ContextOf(TestDaemon& daemon, const std::string& dataset) {
  LearnerContext context = CheetahContext(daemon, dataset);
  context.simulator = {{"gravity", ""}};
  return context;
}

RemoteEnvironment QuerySession(TestDaemon& daemon, const LearnerContext& context) {
  EnvironmentOptions options;
  options.simulator = context.simulator;
  options.num_envs = 0;
  return Take(daemon.client().Make("HalfCheetah", options));
}

ModelData Corrections(TestDaemon& daemon, const LearnerContext& context) {
  const auto dataset = Take(OpenTrainingDataset(context));
  RemoteEnvironment simulator = QuerySession(daemon, context);
  Progress quiet(true);
  return Take(QueryCorrections(context, *dataset, simulator, 1, quiet));
}

DynamicsEnsemble<float> SmallEnsemble() {
  return Take(DynamicsEnsemble<float>::Create(SmallEnsembleOptions()));
}

std::vector<float> Starts(const LearnerContext& context, uint32_t rows) {
  const auto dataset = Take(OpenTrainingDataset(context));
  const TransitionRows batch = Take(dataset->Sample(rows, 7, 0));
  return {batch.observations.begin(), batch.observations.end()};
}

struct RolloutResult {
  RolloutCounts counts;
  BatchBuffer rows;
};

// All transitions of one cycle.
RolloutResult RollOut(TestDaemon& daemon, ModelRolloutOptions options) {
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
  RemoteEnvironment simulator = QuerySession(daemon, context);
  DynamicsEnsemble<float> ensemble = SmallEnsemble();
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.action_scale.assign(kAction, 1.0f);
  options.chunk_rows = 20;
  ModelRollout rollout(options, &simulator, &ensemble);
  SacOptions core;
  core.observation_size = kObservation;
  core.action_size = kAction;
  const PolicyWeights policy = Take(SacCore<float>::Create(core)).Policy();
  RequireOk(rollout.Begin(4, Starts(context, 50), policy));
  ReplayBuffer pool = Take(ReplayBuffer::InMemory({kObservation, kAction, 1000}));
  const RolloutCounts counts = Take(rollout.Finish(pool));
  RolloutResult result = {counts,
                          BatchBuffer(kObservation, kAction, static_cast<int>(pool.size()))};
  for (uint64_t i = 0; i < pool.size(); ++i) pool.Get(i, static_cast<int>(i), result.rows);
  return result;
}

bool Same(const MatrixBuffer<float>& a, const MatrixBuffer<float>& b) {
  return a.values().size() == b.values().size() &&
         std::memcmp(a.values().data(), b.values().data(), a.values().size_bytes()) == 0;
}

}  // namespace

TEST_CASE("The pre-pass's target is the simulator's error, and the reward") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
  const ModelData data = Corrections(daemon, context);
  REQUIRE(data.rows == 300);
  CHECK(data.invalid_rows == 0);

  const auto dataset = Take(OpenTrainingDataset(context));
  const TransitionRows rows = Take(dataset->Read(100, 1));
  RemoteEnvironment simulator = QuerySession(daemon, context);
  std::vector<float> next(kObservation);
  std::vector<double> reward(1);
  std::vector<uint8_t> terminated(1), valid(1);
  RequireOk(simulator.Query(rows.observations, rows.actions, {next, reward, terminated, valid}, 1,
                            0, 100));
  for (int i = 0; i < kObservation; ++i) {
    CHECK(data.targets.view()(i, 100) == rows.next_observations[i] - next[i]);
    CHECK(data.observations.view()(i, 100) == rows.observations[i]);
  }
  CHECK(data.targets.view()(kObservation, 100) == rows.rewards[0]);
}

TEST_CASE("Rows that differ only in a hidden dimension get equal predictions in the pre-pass") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 40);
  // A second file: the same rows, but for the true dimension 9 of observations.
  {
    LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
    const auto dataset = Take(OpenTrainingDataset(context));
    const TransitionRows rows = Take(dataset->Read(0, 40));
    std::vector<float> changed(rows.observations.begin(), rows.observations.end());
    for (size_t row = 0; row < 40; ++row) changed[row * kObservation + 9] += 2.5f;
    DatasetWriterOptions options;
    options.observation_dimensions = kObservation;
    options.action_dimensions = kAction;
    DatasetWriter writer =
        Take(DatasetWriter::Create(daemon.folder("data/HalfCheetah/changed.h5"), options));
    const std::vector<uint8_t> no_timeouts(40, 0);
    DatasetRows out;
    out.rows = 40;
    out.observations = changed;
    out.actions = rows.actions;
    out.next_observations = rows.next_observations;
    out.rewards = rows.rewards;
    out.terminals = rows.terminals;
    out.timeouts = no_timeouts;
    RequireOk(writer.Append(out));
    RequireOk(writer.Commit());
  }
  LearnerContext original = ContextOf(daemon, "HalfCheetah/small");
  LearnerContext changed = ContextOf(daemon, "HalfCheetah/changed");
  // Without the corruption the change must show, or the test would prove nothing.
  CHECK_FALSE(Same(Corrections(daemon, original).targets, Corrections(daemon, changed).targets));
  original.corruption = changed.corruption = {{"hidden", "9"}};
  CHECK(Same(Corrections(daemon, original).targets, Corrections(daemon, changed).targets));
}

TEST_CASE("Rollouts do not depend on how many queries are under way") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 100);
  const RolloutResult several = RollOut(daemon, {});
  ModelRolloutOptions one_by_one;
  one_by_one.chunks_in_flight = 1;
  const RolloutResult singly = RollOut(daemon, one_by_one);
  CHECK(several.counts.rows == 50 * 5);
  CHECK(several.counts.invalid_rows == 0);
  CHECK(Same(several.rows.observations, singly.rows.observations));
  CHECK(Same(several.rows.next_observations, singly.rows.next_observations));
  CHECK(several.rows.rewards == singly.rows.rewards);

  ModelRolloutOptions other_seed;
  other_seed.seed = 1;
  CHECK_FALSE(Same(several.rows.actions, RollOut(daemon, other_seed).rows.actions));
}

TEST_CASE("A rollout that nobody waits for ends with its object") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 100);
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
  RemoteEnvironment simulator = QuerySession(daemon, context);
  DynamicsEnsemble<float> ensemble = SmallEnsemble();
  const SacOptions core = {{.observation_size = kObservation, .action_size = kAction}};
  ModelRolloutOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.action_scale.assign(kAction, 1.0f);
  options.horizon = 1'000'000;  // would take minutes
  options.chunk_rows = 20;
  ModelRollout rollout(options, &simulator, &ensemble);
  RequireOk(rollout.Begin(0, Starts(context, 50), Take(SacCore<float>::Create(core)).Policy()));
  CHECK_FALSE(rollout.done());
}

TEST_CASE("Rollouts keep hidden dimensions at zero and subtract the penalty") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 100);
  ModelRolloutOptions options;
  const RolloutResult plain = RollOut(daemon, options);
  options.penalty = 2;
  const RolloutResult penalised = RollOut(daemon, options);
  CHECK(penalised.counts.reward_sum < plain.counts.reward_sum);
  options.mask.assign(kObservation, 1.0f);
  options.mask[9] = 0;
  const RolloutResult masked = RollOut(daemon, options);
  for (int row = 0; row < masked.rows.size(); ++row) {
    REQUIRE(masked.rows.next_observations.view()(9, row) == 0);
  }
}

TEST_CASE("A dataset's bytes depend on its seed and on neither lanes, workers nor threads") {
  TestDaemon one({"--workers", "1", "--threads", "1"});
  TestDaemon two({"--workers", "2", "--threads", "4"});
  const std::string bytes = ReadBytes(one.MakeDataset("a", 2500, 3, 64));
  CHECK(bytes == ReadBytes(one.MakeDataset("b", 2500, 3, 1)));
  CHECK(bytes == ReadBytes(two.MakeDataset("a", 2500, 3, 2)));
  CHECK(bytes != ReadBytes(one.MakeDataset("c", 2500, 4, 64)));
}

TEST_CASE("Scores depend on neither workers nor threads and are repeatable") {
  TestDaemon one({"--workers", "1", "--threads", "1"});
  TestDaemon two({"--workers", "2", "--threads", "4"});
  const AgentPolicy policy = Take(AgentPolicy::Create(TestDaemon::RandomAgent()));
  Evaluator first = Take(Evaluator::Open(one.client(), "HalfCheetah", {}, 3));
  Evaluator second = Take(Evaluator::Open(two.client(), "HalfCheetah", {}, 3));
  const EvaluationResult result = Take(first.Run(policy));
  CHECK(result.returns == Take(second.Run(policy)).returns);
  CHECK(result.returns == Take(first.Run(policy)).returns);
  CHECK(result.lengths == std::vector<uint32_t>{1000, 1000, 1000});
  CHECK(result.returns[0] != result.returns[1]);
  Evaluator other = Take(Evaluator::Open(one.client(), "HalfCheetah", {}, 3, /*seed=*/1));
  CHECK(result.returns != Take(other.Run(policy)).returns);
}

TEST_CASE("An agent does not see the dimensions hidden in its training unless told to") {
  TestDaemon daemon;
  Agent agent = TestDaemon::RandomAgent();
  agent.observation_mask.assign(kObservation, 1);
  agent.observation_mask[8] = 0;
  Evaluator true_environment = Take(Evaluator::Open(daemon.client(), "HalfCheetah", {}, 2));
  Evaluator hidden = Take(Evaluator::Open(daemon.client(), "HalfCheetah", {{"hidden", "8"}}, 2));
  const AgentPolicy trained = Take(AgentPolicy::Create(agent, Observe::kTrained));
  const AgentPolicy full = Take(AgentPolicy::Create(agent, Observe::kFull));
  const auto masked = Take(true_environment.Run(trained)).returns;
  CHECK(masked == Take(hidden.Run(full)).returns);
  CHECK(masked != Take(true_environment.Run(full)).returns);
}

TEST_CASE("What was hidden in training is shown unscaled, whatever its standard deviation was") {
  TestDaemon daemon;
  Agent agent = TestDaemon::RandomAgent();
  agent.observation_mask.assign(kObservation, 1);
  agent.observation_mask[8] = 0;
  Agent normalised = agent;
  normalised.observation_mean.assign(kObservation, 0);
  normalised.observation_std.assign(kObservation, 1);
  normalised.observation_std[8] = 0.001F;  // what a learner adds to a constant's deviation
  Evaluator evaluator = Take(Evaluator::Open(daemon.client(), "HalfCheetah", {}, 2));
  const AgentPolicy plain = Take(AgentPolicy::Create(agent, Observe::kFull));
  const AgentPolicy scaled = Take(AgentPolicy::Create(normalised, Observe::kFull));
  CHECK(Take(evaluator.Run(plain)).returns == Take(evaluator.Run(scaled)).returns);
}

TEST_CASE("A policy of another size is refused") {
  TestDaemon daemon;
  Agent agent = TestDaemon::RandomAgent();
  agent.history_length = 1;
  agent.hidden[0].inputs = 3;
  agent.hidden[0].weight.resize(3 * 16);
  agent.observation_dimensions = 3;
  agent.observation_mask.clear();
  agent.observation_mean.clear();
  agent.observation_std.clear();
  Evaluator evaluator = Take(Evaluator::Open(daemon.client(), "HalfCheetah", {}, 1));
  const AgentPolicy policy = Take(AgentPolicy::Create(agent));
  CHECK(evaluator.Run(policy).status().code() == StatusCode::kInvalidArgument);
}

}  // namespace b4mrl
