// Benchmarks as objects: their sources, what a policy sees of them, and its score. The daemon, its
// catalogue and the agent are real; b4mrl's own Evaluator says which scores are right.
#include "client/remote_benchmark.h"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <vector>

#include "algorithms/episodes/evaluate.h"
#include "algorithms/policy/agent_policy.h"
#include "proto/wire/named_arguments.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

constexpr char kHidden[] = "HalfCheetah/confounding/hidden-high+medium";  // hides dimension 9
constexpr char kNoisy[] = "HalfCheetah/confounding/obs-noise-high+medium";
constexpr char kClean[] = "HalfCheetah/clean/medium";
constexpr size_t kSize = 17, kActions = 6;
using Observe = EvaluationOptions::Observe;

class Place {
 public:
  Place() { daemon_.MakeDataset("medium", kRows); }
  static constexpr uint64_t kRows = 300;
  Client& client() { return daemon_.client(); }
  RemoteBenchmark Find(const std::string& name) { return Take(client().FindBenchmark(name)); }
  // The returns by which `b4mrl evaluate` scores an agent.
  std::vector<double> Expected(const Agent& agent, const std::vector<NamedArgument>& world = {},
                               uint64_t seed = 0) {
    Evaluator evaluator = Take(Evaluator::Open(client(), "HalfCheetah", world, 2, seed));
    return Take(evaluator.Run(Take(AgentPolicy::Create(agent)))).returns;
  }

 private:
  TestDaemon daemon_;
};

// An agent without history as a user's policy.
BatchPolicy PolicyOf(const Agent& agent) {
  const auto policy = std::make_shared<AgentPolicy>(Take(AgentPolicy::Create(agent)));
  return [policy](const PolicyBatch& batch) {
    const int rows = static_cast<int>(batch.episodes.size());
    policy->Act({batch.observations.data(), static_cast<int>(kSize), rows},
                {batch.actions.data(), static_cast<int>(kActions), rows});
    return Status();
  };
}

Status StandStill(const PolicyBatch& batch) {
  std::ranges::fill(batch.actions, 0.0f);
  return Status();
}

TEST_CASE("A benchmark is the catalogue's entry") {
  Place place;
  const pb::CatalogueReply catalogue = Take(place.client().Catalogue(/*with_benchmarks=*/true));
  const auto entry = std::ranges::find_if(catalogue.benchmarks(),
                                          [](const auto& info) { return info.name() == kHidden; });
  REQUIRE(entry != catalogue.benchmarks().end());
  const RemoteBenchmark bench = place.Find(kHidden);
  CHECK(bench.info().SerializeAsString() == entry->SerializeAsString());
  CHECK(bench.name() == kHidden);
  CHECK(bench.info().corruption() == "hidden-high");
  CHECK(bench.info().paper_size() > 0);
  CHECK(bench.environment().observation.size() == kSize);
}

TEST_CASE("An unknown benchmark is refused with the nearest name") {
  Place place;
  const Status status = place.client().FindBenchmark("HalfCheetah/clean/medum").status();
  CHECK(status.code() == StatusCode::kUnknownName);
  CHECK_THAT(status.message(), Catch::Contains("did you mean 'HalfCheetah/clean/medium'"));
}

TEST_CASE("Simulator, queries and dataset have the flaws of the benchmark") {
  Place place;
  RemoteBenchmark bench = place.Find(kHidden);
  const RemoteEnvironment simulator = Take(bench.MakeSimulator({.num_envs = 3}));
  CHECK(simulator.num_envs() == 3);
  CHECK(NamedArgumentsOf(simulator.in_force().perturbations()) ==
        std::vector<NamedArgument>{{"gravity", "2"}});

  RemoteDataset data = Take(bench.OpenDataset());
  CHECK(data.rows() == Place::kRows);
  const TransitionRows rows = Take(data.Read(0, 5));
  for (size_t row = 0; row < rows.rows; ++row) CHECK(rows.observations[row * kSize + 9] == 0);

  const auto ask = [&](RemoteEnvironment session) {
    std::vector<float> next(rows.rows * kSize);
    std::vector<double> rewards(rows.rows);
    std::vector<uint8_t> ended(rows.rows), valid(rows.rows);
    RequireOk(session.Query(rows.observations, rows.actions, {next, rewards, ended, valid}));
    return next;
  };
  const EnvironmentOptions for_queries = {.num_envs = 0};
  const auto answers = ask(Take(bench.MakeSimulator(for_queries)));
  CHECK(answers == ask(Take(place.client().Make(
                       "HalfCheetah", {.simulator = {{"gravity", "2"}}, .num_envs = 0}))));
  CHECK(answers != ask(Take(place.client().Make("HalfCheetah", for_queries))));
}

TEST_CASE("Other flaws than its own, and data that a benchmark lacks, are refused") {
  Place place;
  RemoteBenchmark bench = place.Find(kHidden);
  CHECK(bench.MakeSimulator({.simulator = {{"friction", "2"}}}).status().code() ==
        StatusCode::kInvalidArgument);
  CHECK(bench.OpenDataset({.corruption = {{"hidden", "1"}}}).status().code() ==
        StatusCode::kInvalidArgument);
  CHECK(bench.MakeSimulator({.ledger = 7}).status().code() == StatusCode::kInvalidArgument);
  CHECK(bench.OpenDataset({.ledger = 7}).status().code() == StatusCode::kInvalidArgument);
  CHECK(bench.Evaluate(StandStill, {.episodes = 0}).status().code() ==
        StatusCode::kInvalidArgument);
  const Status served =
      bench.Evaluate(StandStill, {.episodes = 1, .observe = Observe::kServed}).status();
  CHECK_THAT(served.message(), Catch::Contains("trains without noise"));
  RemoteBenchmark without_data = place.Find("HalfCheetah/simulators/gravity");
  CHECK(without_data.OpenDataset().status().code() == StatusCode::kFailedPrecondition);
  CHECK(place.Find("HalfCheetah/clean/expert").OpenDataset().status().code() ==
        StatusCode::kUnknownName);
}

TEST_CASE("A mask hides what the data or, without data, the simulator hides") {
  Place place;
  std::vector<uint8_t> mask(kSize, 1);
  CHECK(Take(place.Find(kClean).Mask()) == mask);
  mask[9] = 0;
  CHECK(Take(place.Find(kHidden).Mask()) == mask);
  CHECK(Take(place.Find("HalfCheetah/simulators/hidden-high").Mask()) == mask);
  CHECK(Take(place.Find("HalfCheetah/partial-observability-simulator/hidden-high+medium").Mask()) ==
        std::vector<uint8_t>(kSize, 1));
}

TEST_CASE("An agent scores what b4mrl evaluate scores, bit for bit") {
  Place place;
  const Agent agent = TestDaemon::RandomAgent();
  RemoteBenchmark bench = place.Find(kClean);
  const EvaluationResult scores = Take(bench.Evaluate(PolicyOf(agent), {.episodes = 2}));
  CHECK(scores.returns == place.Expected(agent));
  CHECK(scores.lengths == std::vector<uint32_t>{1000, 1000});
  CHECK(scores.mean_return == (scores.returns[0] + scores.returns[1]) / 2);
  CHECK(scores.score == bench.environment().NormalisedScore(scores.mean_return));
  const EvaluationResult held_out =
      Take(bench.Evaluate(PolicyOf(agent), {.episodes = 2, .held_out = true}));
  CHECK(held_out.returns == place.Expected(agent, {}, /*seed=*/1));
  CHECK(held_out.returns != scores.returns);
}

TEST_CASE("A policy of a hidden cell does not see what its training hid, unless in full") {
  Place place;
  const Agent seeing = TestDaemon::RandomAgent();
  Agent masked = seeing;
  masked.observation_mask.assign(kSize, 1);
  masked.observation_mask[9] = 0;
  RemoteBenchmark bench = place.Find(kHidden);
  CHECK(Take(bench.Evaluate(PolicyOf(seeing), {.episodes = 2})).returns == place.Expected(masked));
  CHECK(
      Take(bench.Evaluate(PolicyOf(seeing), {.episodes = 2, .observe = Observe::kFull})).returns ==
      place.Expected(seeing));
}

TEST_CASE("Served observations have the noise of the training, and a world its perturbations") {
  Place place;
  const Agent agent = TestDaemon::RandomAgent();
  RemoteBenchmark noisy = place.Find(kNoisy);
  CHECK(
      Take(noisy.Evaluate(PolicyOf(agent), {.episodes = 2, .observe = Observe::kServed})).returns ==
      place.Expected(agent, {{"obs-noise-high", ""}}));
  RemoteBenchmark delayed = place.Find("HalfCheetah/action-delay/gravity+action-delay");
  const EvaluationOptions in_full = {.episodes = 2, .observe = Observe::kFull};
  CHECK(Take(delayed.Evaluate(PolicyOf(agent), in_full)).returns ==
        place.Expected(agent, {{"action-delay", ""}}));
}

TEST_CASE("The daemon counts what a benchmark's sources and evaluations have served") {
  Place place;
  RemoteBenchmark bench = place.Find(kHidden);
  CHECK(Take(bench.Use()).dataset_rows == 0);
  RemoteEnvironment simulator = Take(bench.MakeSimulator({.num_envs = 3}));
  RequireOk(simulator.Reset().status());
  RequireOk(simulator.Step(std::vector<float>(3 * kActions)).status());
  RemoteDataset data = Take(bench.OpenDataset());
  RequireOk(data.Sample(/*rows=*/8, /*seed=*/1, /*first_batch=*/0).status());
  RequireOk(bench.Evaluate(StandStill, {.episodes = 2}).status());
  const BenchmarkUse use = Take(bench.Use());
  CHECK(use.simulator_steps == 3);
  CHECK(use.query_rows == 0);
  CHECK(use.dataset_rows == 8);
  CHECK(use.evaluation_episodes == 2);

  const uint64_t ledger = Take(place.client().OpenLedger());
  RemoteBenchmark counted = Take(place.client().FindBenchmark(kHidden, ledger));
  RemoteDataset again = Take(counted.OpenDataset());
  RequireOk(again.Read(0, 5).status());
  CHECK(Take(place.client().ReadLedger(ledger)).dataset_rows == 5);
}

TEST_CASE("An evaluation has as many episodes as a session can have lanes, and at least one") {
  Place place;
  RemoteBenchmark bench = place.Find(kClean);
  for (const uint32_t episodes : {0u, 1025u}) {
    const Status refused = bench.Evaluate(StandStill, {.episodes = episodes}).status();
    CHECK(refused.code() == StatusCode::kInvalidArgument);
    CHECK(refused.message() == fmt::format("episodes is {}, allowed: 1..1024", episodes));
  }
}

TEST_CASE("An error of the policy ends the evaluation") {
  Place place;
  RemoteBenchmark bench = place.Find(kClean);
  uint32_t steps = 0;
  const auto failing = [&steps](const PolicyBatch& batch) {
    if (batch.step == 2) return Status(StatusCode::kFailedPrecondition, "not trained");
    ++steps;
    return StandStill(batch);
  };
  CHECK(bench.Evaluate(failing).status().message() == "not trained");
  CHECK(steps == 2);
}

}  // namespace
}  // namespace b4mrl
