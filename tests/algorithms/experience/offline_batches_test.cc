// What offline learners learn from, against a real daemon.
#include "algorithms/experience/offline_batches.h"

#include <catch2/catch.hpp>
#include <vector>

#include "algorithms/experience/training_dataset.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

constexpr int kObservation = 17;
constexpr int kAction = 6;

LearnerContext ContextOf(TestDaemon& daemon, const std::string& dataset) {
  LearnerContext context = CheetahContext(daemon, dataset);
  context.seed = 5;
  return context;
}

// "HalfCheetah/<name>": episodes of one row that end by the step limit, with these rewards and with
// actions of alternating sign at the bounds.
void WriteEpisodes(TestDaemon& daemon, const std::string& name, const std::vector<float>& rewards) {
  DatasetWriterOptions options;
  options.observation_dimensions = kObservation;
  options.action_dimensions = kAction;
  std::filesystem::create_directories(daemon.folder("data/HalfCheetah"));
  DatasetWriter writer =
      Take(DatasetWriter::Create(daemon.folder("data/HalfCheetah/" + name + ".h5"), options));
  const size_t n = rewards.size();
  const std::vector<float> observations(n * kObservation, 0.25f);
  std::vector<float> actions(n * kAction, 1.0f);
  for (size_t i = 0; i < actions.size(); i += 2) actions[i] = -1;
  const std::vector<uint8_t> terminals(n, 0), timeouts(n, 1);
  DatasetRows rows;
  rows.rows = n;
  rows.observations = rows.next_observations = observations;
  rows.actions = actions;
  rows.rewards = rewards;
  rows.terminals = terminals;
  rows.timeouts = timeouts;
  RequireOk(writer.Append(rows));
  RequireOk(writer.Commit());
}

OfflineBatches Opened(const LearnerContext& context, const OfflineBatchOptions& options) {
  OfflineBatches batches = Take(OfflineBatches::Open(context, options));
  batches.Start(0);
  return batches;
}

std::vector<float> Rewards(const TransitionBatch<float>& batch) {
  return {batch.rewards.begin(), batch.rewards.end()};
}

TEST_CASE("Offline batches are the dataset's rows with normalised observations") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
  const auto dataset = Take(OpenTrainingDataset(context));
  const DatasetStats stats = Take(dataset->Stats());
  const TransitionRows rows = Take(dataset->Sample(8, RoleSeed(context.seed, "batches"), 0));
  const bool normalise = GENERATE(true, false);
  OfflineBatches batches = Opened(context, {.batch_size = 8, .normalise = normalise});
  const TransitionBatch<float> batch = Take(batches.Next());
  const PolicyWeights policy = batches.WithInputs({});
  for (int row = 0; row < 8; ++row) {
    for (int i = 0; i < kObservation; ++i) {
      const double mean = normalise ? stats.observation_mean[i] : 0;
      const double std = normalise ? stats.observation_std[i] + 1e-3 : 1;
      const size_t at = static_cast<size_t>(row) * kObservation + i;
      // Subtraction and division of floats: a few roundings of values up to a few units.
      CHECK(batch.observations(i, row) ==
            Approx((rows.observations[at] - mean) / std).margin(1e-5));
      CHECK(batch.next_observations(i, row) ==
            Approx((rows.next_observations[at] - mean) / std).margin(1e-5));
      CHECK(policy.observation_mean[i] == Approx(mean));
      CHECK(policy.observation_std[i] == Approx(std));
    }
    CHECK(batch.rewards[row] == rows.rewards[row]);
    CHECK(batch.actions(2, row) == rows.actions[static_cast<size_t>(row) * kAction + 2]);
    CHECK(batch.not_terminated[row] == 1);
  }
}

TEST_CASE("Offline batches that start later go on with the same rows") {
  TestDaemon daemon;
  daemon.MakeDataset("small", 300);
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/small");
  OfflineBatches from_start = Opened(context, {.batch_size = 8});
  Take(from_start.Next());
  const std::vector<float> second = Rewards(Take(from_start.Next()));
  OfflineBatches later = Take(OfflineBatches::Open(context, {.batch_size = 8}));
  later.Start(1);
  CHECK(Rewards(Take(later.Next())) == second);
  CHECK(Rewards(Take(later.Next())) != second);
}

TEST_CASE("Scaled rewards span returns of 1000, clipped actions stay off the bounds") {
  TestDaemon daemon;
  WriteEpisodes(daemon, "episodes", {-1, 3, 0, 1});
  const LearnerContext context = ContextOf(daemon, "HalfCheetah/episodes");
  OfflineBatches plain = Opened(context, {.batch_size = 16});
  OfflineBatches scaled =
      Opened(context, {.batch_size = 16, .scale_rewards = true, .action_clip = 1e-5});
  const TransitionBatch<float> expected = Take(plain.Next()), batch = Take(scaled.Next());
  for (int row = 0; row < 16; ++row) {
    CHECK(batch.rewards[row] == 250 * expected.rewards[row]);
    for (int i = 0; i < kAction; ++i) {
      CHECK(expected.actions(i, row) == (i % 2 == 0 ? -1 : 1));
      CHECK(batch.actions(i, row) == expected.actions(i, row) * (1 - 1e-5f));
    }
  }
}

TEST_CASE("Scaling by the returns needs complete episodes of different return") {
  TestDaemon daemon;
  daemon.MakeDataset("incomplete", 300);
  WriteEpisodes(daemon, "equal", {2, 2});
  for (const std::string name : {"HalfCheetah/incomplete", "HalfCheetah/equal"}) {
    const Status status =
        OfflineBatches::Open(ContextOf(daemon, name), {.scale_rewards = true}).status();
    CHECK(status.code() == StatusCode::kFailedPrecondition);
    CHECK(status.message().find(name) != std::string::npos);
  }
}

}  // namespace
}  // namespace b4mrl
