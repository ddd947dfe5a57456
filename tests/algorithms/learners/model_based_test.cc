// MOPO's targets and rollouts, which ask no simulator.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "algorithms/experience/training_dataset.h"
#include "algorithms/list.h"
#include "algorithms/model/model_data.h"
#include "algorithms/model/model_rollout.h"
#include "tests/algorithms/fixtures.h"
#include "tests/data/example_dataset.h"

namespace b4mrl {
namespace {

constexpr int kObservation = 17;
constexpr int kAction = 6;
constexpr int kRows = 200;

EnvironmentSpec SpecOf(const std::string& name) {
  EnvironmentSpec spec;
  spec.name = name;
  spec.observation.dimensions.resize(kObservation);
  spec.termination.emplace();
  if (name == "Walker2d") {
    spec.termination = std::vector<DimensionBounds>{{0, 0.8, 2}, {1, -1, 1}};
  }
  return spec;
}

DynamicsEnsemble<float> SmallEnsemble() {
  DynamicsEnsembleOptions options = SmallEnsembleOptions();
  options.max_log_var = -2;  // a walker falls within a few steps, but not at once
  return Take(DynamicsEnsemble<float>::Create(options));
}

// Healthy walkers.
std::vector<float> Starts() {
  std::vector<float> starts(kRows * kObservation);
  Rng(3, "model-based-test").FillNormal(starts);
  for (float& value : starts) value *= 0.1f;
  for (int row = 0; row < kRows; ++row) starts[row * kObservation] += 1.4f;
  return starts;
}

struct RolloutResult {
  RolloutCounts counts;
  BatchBuffer rows;
};

RolloutResult RollOut(const std::string& rule, ModelRolloutOptions options,
                      DynamicsEnsemble<float> ensemble, uint64_t cycle = 2) {
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.action_scale.assign(kAction, 1.0f);
  options.termination = Take(Termination::Of(SpecOf(rule)));
  ModelRollout rollout(options, nullptr, &ensemble);
  SacOptions core;
  core.observation_size = kObservation;
  core.action_size = kAction;
  RequireOk(rollout.Begin(cycle, Starts(), Take(SacCore<float>::Create(core)).Policy()));
  ReplayBuffer pool = Take(ReplayBuffer::InMemory({kObservation, kAction, 2000}));
  const RolloutCounts counts = Take(rollout.Finish(pool));
  RolloutResult result = {counts,
                          BatchBuffer(kObservation, kAction, static_cast<int>(pool.size()))};
  for (uint64_t i = 0; i < pool.size(); ++i) pool.Get(i, static_cast<int>(i), result.rows);
  return result;
}

RolloutResult RollOut(const std::string& rule, ModelRolloutOptions options = {}) {
  return RollOut(rule, std::move(options), SmallEnsemble());
}

std::vector<float> Column(const MatrixBuffer<float>& matrix, int column) {
  const float* first = matrix.view().column(column);
  return {first, first + matrix.rows()};
}

// A dataset of Humanoid's width, whose first observation value is the row's number.
void WriteWideDataset(const TestDaemon& daemon, int rows) {
  constexpr int kWide = 376, kWideAction = 17;
  std::filesystem::create_directories(daemon.folder("data/Humanoid"));
  DatasetWriterOptions options;
  options.observation_dimensions = kWide;
  options.action_dimensions = kWideAction;
  DatasetWriter writer =
      Take(DatasetWriter::Create(daemon.folder("data/Humanoid/wide.h5"), options));
  std::vector<float> observations(static_cast<size_t>(rows) * kWide);
  for (int row = 0; row < rows; ++row) observations[row * kWide] = static_cast<float>(row);
  const std::vector<float> actions(static_cast<size_t>(rows) * kWideAction), rewards(rows);
  const std::vector<uint8_t> flags(rows);
  RequireOk(writer.Append({{.rows = static_cast<size_t>(rows),
                            .observations = observations,
                            .actions = actions,
                            .rewards = rewards,
                            .next_observations = observations,
                            .terminals = flags,
                            .timeouts = flags}}));
  RequireOk(writer.Commit());
}

}  // namespace

TEST_CASE("Rollouts start from as many wide rows as are asked for") {
  TestDaemon daemon;
  WriteWideDataset(daemon, 500);
  RemoteDataset dataset = Take(daemon.client().OpenDataset("Humanoid/wide"));
  const uint32_t most = dataset.max_rows_per_request();
  CHECK(most < 50'000);
  CHECK(dataset.Sample(most, 7, 0, 1, /*with_indices=*/true).ok());
  const std::vector<float> starts = Take(DrawStarts(dataset, 50'000, 7, 2));
  REQUIRE(starts.size() == 50'000 * dataset.observation_size());
  // Three requests a cycle, each a batch of its own.
  const TransitionRows last = Take(dataset.Sample(50'000 - 2 * most, 7, 2 * 3 + 2));
  CHECK(std::equal(last.observations.begin(), last.observations.end(),
                   starts.end() - static_cast<std::ptrdiff_t>(last.observations.size())));
  CHECK(last.observations[0] != starts[0]);
}

TEST_CASE("Rollouts start from one batch where one request holds it") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  RemoteDataset dataset = Take(daemon.client().OpenDataset("HalfCheetah/small"));
  CHECK(dataset.max_rows_per_request() == limits::kMaxRowsPerBatch);
  const std::vector<float> starts = Take(DrawStarts(dataset, 50'000, 7, 2));
  const TransitionRows batch = Take(dataset.Sample(50'000, 7, 2));
  CHECK(std::equal(starts.begin(), starts.end(), batch.observations.begin(),
                   batch.observations.end()));
}

TEST_CASE("MOPO learns what a step changed, and the reward") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  const auto dataset = Take(OpenTrainingDataset(context));
  Progress quiet(true);
  const ModelData data = Take(ReadChanges(context, *dataset, quiet));
  REQUIRE(data.rows == 300);
  CHECK(data.invalid_rows == 0);
  const TransitionRows rows = Take(dataset->Read(100, 1));
  for (int i = 0; i < kObservation; ++i) {
    CHECK(data.targets.view()(i, 100) == rows.next_observations[i] - rows.observations[i]);
    CHECK(data.observations.view()(i, 100) == rows.observations[i]);
  }
  CHECK(data.targets.view()(kObservation, 100) == rows.rewards[0]);
}

TEST_CASE("The rule d4rl teaches no model that a fall leads to the next episode's start") {
  TestDaemon daemon;
  std::filesystem::create_directories(daemon.folder("data/HalfCheetah"));
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  // Rows 49 and 99 end by time-out and by a fall.
  RequireOk(WriteExample(daemon.folder("data/HalfCheetah/falls.h5"),
                         MakeExampleDataset({50, 50, 50}, kObservation, 6), provenance));
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/falls");
  Progress quiet(true);
  const ModelData stored = Take(ReadChanges(context, *Take(OpenTrainingDataset(context)), quiet));
  CHECK(stored.rows == 150);
  context.transitions = "d4rl";
  const auto dataset = Take(OpenTrainingDataset(context));
  REQUIRE(dataset->rows() == 148);
  const ModelData followed = Take(ReadChanges(context, *dataset, quiet));
  CHECK(followed.rows == 147);
  CHECK(followed.invalid_rows == 1);
  // Row 98 of those served is the fall; the first row of the third episode takes its place.
  const TransitionRows rows = Take(dataset->Read(98, 2));
  REQUIRE(rows.terminals[0] == 1);
  CHECK(followed.observations.view()(0, 98) == rows.observations[kObservation]);
}

TEST_CASE("A rollout without a simulator goes on from o + delta until the rule ends it") {
  const RolloutResult result = RollOut("Walker2d");
  const Termination rule = Take(Termination::Of(SpecOf("Walker2d")));
  // One chunk: the rows of a step, then those of the next one, which are the ones that went on.
  const std::vector<float> starts = Starts();
  std::vector<std::vector<float>> expected;
  for (int row = 0; row < kRows; ++row) {
    expected.emplace_back(starts.begin() + row * kObservation,
                          starts.begin() + (row + 1) * kObservation);
  }
  int at = 0;
  uint64_t terminated = 0;
  for (int step = 0; step < 5; ++step) {
    std::vector<std::vector<float>> next;
    for (const std::vector<float>& observation : expected) {
      REQUIRE(at < result.rows.size());
      REQUIRE(Column(result.rows.observations, at) == observation);
      std::vector<float> reached = Column(result.rows.next_observations, at);
      const bool ends = rule.Ends(reached);
      REQUIRE(result.rows.not_terminated[at] == (ends ? 0.0f : 1.0f));
      terminated += ends ? 1 : 0;
      if (!ends) next.push_back(std::move(reached));
      ++at;
    }
    expected = std::move(next);
  }
  CHECK(at == result.rows.size());
  CHECK(result.counts.rows == static_cast<uint64_t>(at));
  CHECK(result.counts.terminated_rows == terminated);
  // Otherwise the above showed little.
  CHECK(terminated > 10);
  CHECK(terminated < kRows);
}

TEST_CASE("Rows that end change nothing for those that go on") {
  const RolloutResult never = RollOut("HalfCheetah"), walker = RollOut("Walker2d");
  REQUIRE(never.counts.rows == 5 * kRows);
  int survivors = 0;
  for (int row = 0; row < kRows; ++row) {
    if (walker.rows.not_terminated[row] == 0) continue;
    const int place = kRows + survivors++;  // among the rows of the second step
    // The policy is evaluated in a fixed order, so equal inputs and noise give equal bits.
    REQUIRE(Column(walker.rows.actions, place) == Column(never.rows.actions, kRows + row));
  }
  CHECK(survivors < kRows);
}

TEST_CASE("Chunks whose rows all end early leave the order of rows as it is") {
  ModelRolloutOptions options;
  options.chunk_rows = 1;
  options.chunks_in_flight = 3;
  const RolloutResult result = RollOut("Walker2d", options);
  const std::vector<float> starts = Starts();
  int row = -1;
  for (int at = 0; at < result.rows.size(); ++at) {
    const std::vector<float> observation = Column(result.rows.observations, at);
    const bool is_start = row + 1 < kRows && std::equal(observation.begin(), observation.end(),
                                                        starts.begin() + (row + 1) * kObservation);
    if (is_start) ++row;
  }
  CHECK(row == kRows - 1);
}

TEST_CASE("A penalty takes the largest deviation from each reward") {
  ModelRolloutOptions options;
  options.horizon = 1;
  const RolloutResult plain = RollOut("HalfCheetah", options);
  options.penalty = 0.5;
  const RolloutResult once = RollOut("HalfCheetah", options);
  options.penalty = 1;
  const RolloutResult twice = RollOut("HalfCheetah", options);
  for (int row = 0; row < kRows; ++row) {
    const float first = plain.rows.rewards[row] - once.rows.rewards[row];
    const float second = once.rows.rewards[row] - twice.rows.rewards[row];
    CHECK(first > 0);
    CHECK(second == Approx(first).margin(1e-5));  // rewards of order one, rounded in float
  }
}

TEST_CASE("Each step of a rollout is an elite's, and every elite has its share of them") {
  DynamicsEnsembleOptions options = SmallEnsembleOptions();  // two elites of three members
  options.min_log_var = -30;
  options.max_log_var = -25;  // deviations of 4e-6: a step tells whose it is
  DynamicsEnsemble<float> ensemble = Take(DynamicsEnsemble<float>::Create(options));
  ensemble.VisitArrays([](const NamedArray<float>& array) {
    if (array.name != "best_holdout_mse") return;
    array.values[0] = 0.3f;
    array.values[1] = 0.1f;
    array.values[2] = 0.2f;
  });
  REQUIRE(ensemble.Elites() == std::vector<int>{1, 2});
  ModelRolloutOptions one_step;
  one_step.horizon = 1;
  const BatchBuffer rows = RollOut("HalfCheetah", one_step, ensemble).rows;
  REQUIRE(rows.size() == kRows);

  MatrixBuffer<float> inputs(kObservation + kAction, kRows);
  for (int row = 0; row < kRows; ++row) {
    float* input = inputs.view().column(row);
    std::copy_n(rows.observations.view().column(row), kObservation, input);
    std::copy_n(rows.actions.view().column(row), kAction, input + kObservation);
  }
  MatrixBuffer<float> mean(kObservation + 1, kRows), log_var(kObservation + 1, kRows);
  std::vector<int> steps_of_member(3);
  for (int member = 0; member < 3; ++member) {
    ensemble.Predict(member, inputs.view(), mean.view(), log_var.view());
    for (int row = 0; row < kRows; ++row) {
      float error = std::abs(rows.rewards[row] - mean.view()(kObservation, row));
      for (int i = 0; i < kObservation; ++i) {
        const float change =
            rows.next_observations.view()(i, row) - rows.observations.view()(i, row);
        error = std::max(error, std::abs(change - mean.view()(i, row)));
      }
      // Ten deviations; members are tenths apart.
      if (error < 4e-5f) ++steps_of_member[member];
    }
  }
  CHECK(steps_of_member[0] == 0);
  CHECK(steps_of_member[1] + steps_of_member[2] == kRows);
  CHECK(steps_of_member[1] > kRows / 3);
  CHECK(steps_of_member[2] > kRows / 3);
}

TEST_CASE("The elite of a row is drawn anew in every step of every cycle") {
  DynamicsEnsembleOptions options = SmallEnsembleOptions();
  options.min_log_var = -30;
  options.max_log_var = -25;  // deviations of 4e-6: a step tells whose it is
  DynamicsEnsemble<float> ensemble = Take(DynamicsEnsemble<float>::Create(options));
  // A member's reward is the same for every row then.
  ensemble.VisitArrays([](const NamedArray<float>& array) {
    if (array.name == "ensemble/layer4/weight") std::ranges::fill(array.values, 0.0f);
  });
  ModelRolloutOptions two_steps;
  two_steps.horizon = 2;
  std::set<std::vector<bool>> draws;  // of each step, whose reward is that of the very first row
  std::optional<float> reward;
  for (const uint64_t cycle : {0, 1}) {
    const BatchBuffer rows = RollOut("HalfCheetah", two_steps, ensemble, cycle).rows;
    REQUIRE(rows.size() == 2 * kRows);
    if (!reward) reward = rows.rewards[0];
    for (const int step : {0, 1}) {
      std::vector<bool> same(kRows);
      for (int row = 0; row < kRows; ++row) {
        // Ten deviations; members are tenths apart.
        same[row] = std::abs(rows.rewards[step * kRows + row] - *reward) < 4e-5f;
      }
      draws.insert(same);
    }
  }
  CHECK(draws.size() == 4);
}

TEST_CASE("The horizon's default is the environment's") {
  const Algorithm* mopo = Take(FindAlgorithm("mopo"));
  CHECK(Hyperparameters(mopo->hyperparameters, "HalfCheetah").Integer("horizon") == 5);
  CHECK(Hyperparameters(mopo->hyperparameters, "Walker2d").Integer("horizon") == 1);
}

TEST_CASE("A dataset of another task is refused although it has the same sizes") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 50);
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.environment = Take(daemon.client().FindEnvironment("Walker2d"));
  const Status status = OpenTrainingDataset(context).status();
  INFO(status.ToString());
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK(status.message().find("HalfCheetah") != std::string::npos);
  CHECK(status.message().find("Walker2d") != std::string::npos);
}

TEST_CASE("MOPO refuses an environment whose end no observation tells") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 50);
  LearnerContext context = CheetahContext(daemon, "HalfCheetah/small");
  context.environment.termination.reset();
  const Algorithm* mopo = Take(FindAlgorithm("mopo"));
  context.hyperparameters = Hyperparameters(mopo->hyperparameters);
  CHECK(mopo->create(context).status().code() == StatusCode::kUnsupported);
}

}  // namespace b4mrl
