#include "algorithms/rl/td3_core.h"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "tests/algorithms/reference_file.h"

namespace b4mrl {
namespace {

Td3Options ReferenceOptions(const ReferenceFile& file) {
  Td3Options options;
  options.observation_size = file.Get("batch/observations").shape[1];
  options.action_size = file.Get("batch/actions").shape[1];
  options.hidden = {file.Get("initial/actor/layer0/bias").shape[0],
                    file.Get("initial/actor/layer1/bias").shape[0]};
  options.batch_max = file.Get("batch/observations").shape[0];
  options.bc_alpha = 2.5;
  return options;
}

// A core with the file's initial weights, for the targets too.
template <typename Scalar>
Td3Core<Scalar> ReferenceCore(const ReferenceFile& file) {
  Result<Td3Core<Scalar>> core = Td3Core<Scalar>::Create(ReferenceOptions(file));
  REQUIRE(core.ok());
  core->VisitArrays([&](const NamedArray<Scalar>& array) {
    if (array.name.find("/layer") == std::string::npos) return;
    std::string source = array.name;
    if (const size_t at = source.find("_target"); at != std::string::npos) source.erase(at, 7);
    file.Load("initial", NamedArray<Scalar>{source, array.shape, array.values});
  });
  return std::move(core).value();
}

template <typename Scalar>
Td3Metrics ReferenceStep(const ReferenceFile& file, const std::string& step,
                         Td3Core<Scalar>& core) {
  const ReferenceBatch<Scalar> batch(file);
  const MatrixBuffer<Scalar> noise = file.Matrix<Scalar>(step + "/noise");
  return core.UpdateWithNoise(batch.Views(), noise.view());
}

template <typename Scalar>
void CheckGradients(const ReferenceFile& file, const std::string& step, bool with_actor,
                    double tolerance, Td3Core<Scalar>& core) {
  core.VisitGradients([&](const NamedArray<Scalar>& array) {
    INFO(step << " " << array.name);
    if (array.name.starts_with("actor") && !with_actor) return;
    CHECK(file.Difference(step + "/gradient", array) < tolerance);
  });
}

TEST_CASE("four TD3-BC updates in double equal PyTorch's") {
  const ReferenceFile file("td3_bc.ref");
  Td3Core<double> core = ReferenceCore<double>(file);
  // Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
  constexpr double kTolerance = 1e-9;
  for (int step = 1; step <= 4; ++step) {
    const std::string name = "step" + std::to_string(step);
    const bool delayed_step = step % 2 == 0;
    const Td3Metrics metrics = ReferenceStep(file, name, core);
    CheckGradients(file, name, delayed_step, kTolerance, core);
    const std::vector<double> expected =
        file.Vector<double>(name + "/critic_actor_bc_losses_and_lambda");
    CHECK(metrics.critic_loss == Approx(expected[0]).epsilon(kTolerance));
    if (!delayed_step) continue;
    CHECK(metrics.actor_loss == Approx(expected[1]).epsilon(kTolerance));
    CHECK(metrics.bc_loss == Approx(expected[2]).epsilon(kTolerance));
    CHECK(metrics.lambda == Approx(expected[3]).epsilon(kTolerance));
  }
  core.VisitArrays([&](const NamedArray<double>& array) {
    if (array.name.find("/layer") == std::string::npos) return;
    INFO(array.name);
    CHECK(file.Difference("final", array) < kTolerance);
  });
}

TEST_CASE("TD3-BC updates in float have PyTorch's gradients to float's precision") {
  const ReferenceFile file("td3_bc.ref");
  Td3Core<float> core = ReferenceCore<float>(file);
  // Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
  ReferenceStep(file, "step1", core);
  CheckGradients(file, "step1", /*with_actor=*/false, 1e-5, core);
  ReferenceStep(file, "step2", core);
  CheckGradients(file, "step2", /*with_actor=*/true, 1e-5, core);
}

}  // namespace
}  // namespace b4mrl
