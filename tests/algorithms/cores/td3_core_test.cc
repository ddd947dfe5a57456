#include "algorithms/cores/td3_core.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/algorithms/random_batch.h"
#include "tests/algorithms/reference_file.h"

namespace b4mrl {
namespace {

// With `bc_alpha` TD3-BC, without it TD3.
Td3Options ReferenceOptions(const ReferenceFile& file, std::optional<double> bc_alpha) {
  Td3Options options;
  SetReferenceSizes(file, &options);
  options.bc_alpha = bc_alpha;
  return options;
}

// A core with the file's initial weights, for the targets too.
template <typename Scalar>
Td3Core<Scalar> ReferenceCore(const ReferenceFile& file, std::optional<double> bc_alpha) {
  Result<Td3Core<Scalar>> core = Td3Core<Scalar>::Create(ReferenceOptions(file, bc_alpha));
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
  return core.Update(batch.Views(), noise.view());
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

// Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
constexpr double kDoubleTolerance = 1e-9;
// Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
constexpr double kFloatTolerance = 1e-5;

// `losses`: the critics', the actor's, then TD3-BC's cloning loss and lambda.
void CheckMetrics(const Td3Metrics& metrics, const std::vector<double>& losses) {
  CHECK(metrics.critic_loss == Approx(losses[0]).epsilon(kDoubleTolerance));
  if (losses.size() == 1) return;  // no delayed step
  CHECK(metrics.actor_loss == Approx(losses[1]).epsilon(kDoubleTolerance));
  REQUIRE(metrics.bc_loss.has_value() == (losses.size() == 4));
  if (losses.size() == 2) return;
  CHECK(metrics.bc_loss.value() == Approx(losses[2]).epsilon(kDoubleTolerance));
  CHECK(metrics.lambda.value() == Approx(losses[3]).epsilon(kDoubleTolerance));
}

// Four updates of the critics, two of the actor.
void CheckDoubleUpdates(const ReferenceFile& file, std::optional<double> bc_alpha) {
  Td3Core<double> core = ReferenceCore<double>(file, bc_alpha);
  const std::string losses =
      bc_alpha ? "/critic_actor_bc_losses_and_lambda" : "/critic_actor_losses";
  for (int step = 1; step <= 4; ++step) {
    const std::string name = "step" + std::to_string(step);
    const Td3Metrics metrics = ReferenceStep(file, name, core);
    CheckGradients(file, name, /*with_actor=*/step % 2 == 0, kDoubleTolerance, core);
    CheckMetrics(metrics, file.Vector<double>(name + losses));
  }
  core.VisitArrays([&](const NamedArray<double>& array) {
    if (array.name.find("/layer") == std::string::npos) return;
    INFO(array.name);
    CHECK(file.Difference("final", array) < kDoubleTolerance);
  });
}

void CheckFloatGradients(const ReferenceFile& file, std::optional<double> bc_alpha) {
  Td3Core<float> core = ReferenceCore<float>(file, bc_alpha);
  ReferenceStep(file, "step1", core);
  CheckGradients(file, "step1", /*with_actor=*/false, kFloatTolerance, core);
  ReferenceStep(file, "step2", core);
  CheckGradients(file, "step2", /*with_actor=*/true, kFloatTolerance, core);
}

// The mean target of a first update whose target policy takes the action tanh(`head`) everywhere,
// smoothed by noise of `deviation`.
double MeanTarget(double head, double deviation) {
  constexpr int kObservation = 3, kAction = 2, kRows = 8;
  Td3Options options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.hidden = {8, 8};
  options.policy_noise = 1;
  options.noise_clip = 0.5;
  auto core = Td3Core<double>::Create(options);
  REQUIRE(core.ok());
  core->VisitArrays([&](const NamedArray<double>& array) {
    if (array.name == "actor_target/layer2/weight") std::ranges::fill(array.values, 0.0);
    if (array.name == "actor_target/layer2/bias") std::ranges::fill(array.values, head);
  });
  const RandomBatch<double> batch(kObservation, kAction, kRows, 1);
  MatrixBuffer<double> noise(kAction, kRows);
  std::ranges::fill(noise.values(), deviation);
  return core->Update(batch.Views(), noise.view()).mean_target;
}

TEST_CASE("a smoothed target action stays in [-1, 1]") {
  const double side = GENERATE(1, -1);
  const double at_bound = MeanTarget(20 * side, 0);  // where tanh is 1 in double
  // tanh(3) = 0.995, and noise clipped to 0.5.
  CHECK(MeanTarget(3 * side, 9 * side) == Approx(at_bound).epsilon(kDoubleTolerance));
  CHECK(MeanTarget(3 * side, 0) != Approx(at_bound).epsilon(kDoubleTolerance));
}

TEST_CASE("four TD3 updates in double equal PyTorch's") {
  CheckDoubleUpdates(ReferenceFile("td3.ref"), {});
}

TEST_CASE("four TD3-BC updates in double equal PyTorch's") {
  CheckDoubleUpdates(ReferenceFile("td3_bc.ref"), 2.5);
}

TEST_CASE("TD3 updates in float have PyTorch's gradients to float's precision") {
  CheckFloatGradients(ReferenceFile("td3.ref"), {});
}

TEST_CASE("TD3-BC updates in float have PyTorch's gradients to float's precision") {
  CheckFloatGradients(ReferenceFile("td3_bc.ref"), 2.5);
}

}  // namespace
}  // namespace b4mrl
