// --precision of every learner, against a real daemon.
#include <catch2/catch.hpp>
#include <memory>
#include <vector>

#include "algorithms/policy/inference.h"
#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

// What a small learner has learned after some updates.
std::vector<float> Learned(TestDaemon& daemon, const Algorithm& algorithm, Precision precision) {
  LearnerContext context = CheetahContext(daemon);
  if (algorithm.needs.dataset) context.dataset = "HalfCheetah/small";
  const TemporaryFolder folder;
  context.folder = folder.path();
  context.precision = precision;
  context.hyperparameters = Hyperparameters(algorithm.hyperparameters);
  for (const auto& [name, value] : {std::pair{"hidden-width", 16.0},
                                    {"batch-size", 32},
                                    {"warm-up", 100},
                                    {"steps-per-cycle", 40},
                                    {"discriminator-batch", 24},
                                    {"gap-samples", 2},
                                    {"ensemble-width", 16},
                                    {"ensemble-max-updates", 5},
                                    {"ensemble-cache", 0},
                                    {"rollout-rows", 100}}) {
    if (context.hyperparameters.Find(name) == nullptr) continue;
    RequireOk(context.hyperparameters.Set(name, value));
  }
  const std::unique_ptr<Learner> learner = Take(algorithm.create(context));
  Progress quiet(true);
  RequireOk(learner->Prepare(quiet));
  MetricMeans metrics;
  for (int update = 0; update < 8; ++update) RequireOk(learner->Update(metrics));
  return FlattenPolicy(learner->Policy());
}

TEST_CASE("Every learner learns something else in bf16 than in fp32") {
  if (!HasBf16()) {
    WARN("SKIPPED: this processor has no AVX512-BF16");
    return;
  }
  TestDaemon daemon;
  daemon.MakeDataset("small", 2000);
  for (const Algorithm& algorithm : Algorithms()) {
    INFO(algorithm.name);
    const std::vector<float> fp32 = Learned(daemon, algorithm, Precision::kFp32);
    CHECK(Learned(daemon, algorithm, Precision::kFp32) == fp32);
    CHECK(Learned(daemon, algorithm, Precision::kBf16) != fp32);
  }
}

}  // namespace
}  // namespace b4mrl
