#include "algorithms/cores/sac_core.h"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "tests/algorithms/reference_file.h"

namespace b4mrl {
namespace {

SacOptions ReferenceOptions(const ReferenceFile& file) {
  SacOptions options;
  SetReferenceSizes(file, &options);
  options.policy.log_std_min = -5;  // LOG_STD_RANGE of dump_pytorch.py
  options.policy.log_std_max = 0.5;
  return options;
}

// A core with the file's initial weights.
template <typename Scalar>
SacCore<Scalar> ReferenceCore(const ReferenceFile& file) {
  Result<SacCore<Scalar>> core = SacCore<Scalar>::Create(ReferenceOptions(file));
  REQUIRE(core.ok());
  core->VisitArrays([&](const NamedArray<Scalar>& array) {
    std::string source = array.name;
    if (source.starts_with("critic_target/")) source.replace(0, 13, "critic");
    if (!source.starts_with("actor/layer") && !source.starts_with("critic/layer")) return;
    file.Load("initial", NamedArray<Scalar>{source, array.shape, array.values});
  });
  return std::move(core).value();
}

template <typename Scalar>
SacMetrics ReferenceStep(const ReferenceFile& file, const std::string& step,
                         SacCore<Scalar>& core) {
  const ReferenceBatch<Scalar> batch(file);
  const MatrixBuffer<Scalar> noise = file.ActionNoise<Scalar>(step);
  return core.Update(batch.Views(), noise.view());
}

TEST_CASE("two SAC updates in double equal PyTorch's") {
  const ReferenceFile file("sac.ref");
  SacCore<double> core = ReferenceCore<double>(file);
  // Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
  constexpr double kTolerance = 1e-9;
  for (const std::string step : {"step1", "step2"}) {
    const SacMetrics metrics = ReferenceStep(file, step, core);
    core.VisitGradients([&](const NamedArray<double>& array) {
      INFO(step << " " << array.name);
      CHECK(file.Difference(step + "/gradient", array) < kTolerance);
    });
    const std::vector<double> expected =
        file.Vector<double>(step + "/critic_actor_alpha_losses_and_alpha");
    CHECK(metrics.critic_loss == Approx(expected[0]).epsilon(kTolerance));
    CHECK(metrics.actor_loss == Approx(expected[1]).epsilon(kTolerance));
    CHECK(metrics.alpha_loss == Approx(expected[2]).epsilon(kTolerance));
    CHECK(metrics.alpha == Approx(expected[3]).epsilon(kTolerance));
  }
  core.VisitArrays([&](const NamedArray<double>& array) {
    INFO(array.name);
    if (array.name == "log_alpha") CHECK(file.Difference("step2", array) < kTolerance);
    if (array.name.find("/layer") == std::string::npos) return;
    CHECK(file.Difference("final", array) < kTolerance);
  });
}

TEST_CASE("a SAC update in float has PyTorch's gradients to float's precision") {
  const ReferenceFile file("sac.ref");
  SacCore<float> core = ReferenceCore<float>(file);
  ReferenceStep(file, "step1", core);
  core.VisitGradients([&](const NamedArray<float>& array) {
    INFO(array.name);
    // Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
    CHECK(file.Difference("step1/gradient", array) < 1e-5);
  });
}

}  // namespace
}  // namespace b4mrl
