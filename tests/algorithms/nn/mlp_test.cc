#include "algorithms/nn/mlp.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

constexpr int kBatch = 5;

MlpShape Shape(int members, int outputs, Activation activation) {
  return {.members = members,
          .inputs = 4,
          .hidden = {7, 3},
          .outputs = outputs,
          .activation = activation};
}

// A network, an input, and the loss sum(weights * output) whose output gradient is `weights`.
struct Fixture {
  explicit Fixture(const MlpShape& shape, bool shared_input)
      : layout(shape),
        parameters(layout.size()),
        gradient(layout.size()),
        input((shared_input ? 1 : shape.members) * shape.inputs, kBatch),
        weights(shape.members * shape.outputs, kBatch),
        workspace(layout, {.members = shape.members, .batch_max = kBatch}) {
    Rng rng(3, "mlp-test");
    layout.Initialize<double>(Initialization::kTorchUniform, rng, parameters);
    rng.FillNormal(input.values());
    rng.FillNormal(weights.values());
  }

  double Loss() {
    const MatrixView<double> output =
        MlpForward<double>(layout, parameters, input.view(), workspace);
    double sum = 0;
    for (int i = 0; i < output.columns; ++i) {
      for (int k = 0; k < output.rows; ++k) sum += weights.view()(k, i) * output(k, i);
    }
    return sum;
  }

  void Backward() {
    Loss();
    std::copy(weights.values().begin(), weights.values().end(), workspace.output_gradient().data);
    MlpBackward<double>(layout, parameters, input.view(), workspace, gradient);
  }
  // d loss / d rows 1 and 2 of 4 of the input: the place of an action inside a critic's input.
  MatrixBuffer<double> InputGradient() {
    Loss();
    std::copy(weights.values().begin(), weights.values().end(), workspace.output_gradient().data);
    MatrixBuffer<double> input_gradient(2, kBatch);
    MlpBackwardToInput<double>(layout, parameters, 1, workspace, input_gradient.view());
    return input_gradient;
  }

  MlpLayout layout;
  AlignedVector<double> parameters, gradient;
  MatrixBuffer<double> input, weights;
  MlpWorkspace<double> workspace;
};

TEST_CASE("parameter gradients of a perceptron equal finite differences") {
  const Activation activation = GENERATE(Activation::kRelu, Activation::kSwish);
  const int members = GENERATE(1, 3);
  const int outputs = GENERATE(1, 2);
  const bool shared_input = GENERATE(true, false);
  Fixture f(Shape(members, outputs, activation), shared_input);
  f.Backward();
  CheckGradient(
      f.parameters, f.gradient, [&] { return f.Loss(); }, 200);
}

TEST_CASE("the input gradient sums over the members that share the input") {
  const Activation activation = GENERATE(Activation::kRelu, Activation::kSwish);
  const int members = GENERATE(1, 2);
  Fixture f(Shape(members, 1, activation), /*shared_input=*/true);
  MatrixBuffer<double> gradient = f.InputGradient();
  for (int i = 0; i < kBatch; ++i) {
    CheckGradient({f.input.view().column(i) + 1, 2}, {gradient.view().column(i), 2},
                  [&] { return f.Loss(); });
  }
}

TEST_CASE("the input gradient leaves out columns in which a member has no output gradient") {
  const Activation activation = GENERATE(Activation::kRelu, Activation::kSwish);
  const int outputs = GENERATE(1, 2);
  Fixture f(Shape(2, outputs, activation), /*shared_input=*/true);
  // Both members have a gradient in column 4, one of them in columns 0 to 2, none in column 3; in
  // the last section, the second member has none in any column.
  const bool second_has_any = GENERATE(true, false);
  const auto clear = [&](int member, int column) {
    std::fill_n(f.weights.view().column(column) + member * outputs, outputs, 0.0);
  };
  for (const int column : {0, 2, 3}) clear(0, column);
  for (const int column : {1, 3}) clear(1, column);
  for (int column = 0; column < kBatch && !second_has_any; ++column) clear(1, column);
  MatrixBuffer<double> gradient = f.InputGradient();
  CHECK(f.workspace.kept[0] == std::vector<int>{1, 4});
  CHECK(f.workspace.kept[1] == (second_has_any ? std::vector<int>{0, 2, 4} : std::vector<int>{}));
  CHECK(gradient.view()(0, 3) == 0);
  for (int i = 0; i < kBatch; ++i) {
    CheckGradient({f.input.view().column(i) + 1, 2}, {gradient.view().column(i), 2},
                  [&] { return f.Loss(); });
  }
}

TEST_CASE("a pass over one member gives that member's rows and gradients") {
  Fixture f(Shape(3, 2, Activation::kSwish), /*shared_input=*/true);
  f.Loss();
  MlpWorkspace<double> single(f.layout, {.batch_max = kBatch});
  for (int member = 0; member < 3; ++member) {
    const MatrixView<double> output =
        MlpForward<double>(f.layout, f.parameters, f.input.view(), single, member);
    for (int i = 0; i < kBatch; ++i) {
      for (int k = 0; k < 2; ++k) {
        // Products of other shapes may sum in another order.
        CHECK(output(k, i) == Approx(f.workspace.output()(2 * member + k, i)).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE("threads change no bit of outputs and gradients") {
  const bool shared_input = GENERATE(true, false);
  Fixture alone(Shape(5, 2, Activation::kSwish), shared_input);
  Fixture team(Shape(5, 2, Activation::kSwish), shared_input);
  team.workspace =
      MlpWorkspace<double>(team.layout, {.members = 5, .batch_max = kBatch, .threads = 3});
  CHECK(team.workspace.team->threads() == 3);
  alone.Backward();
  team.Backward();
  CHECK(team.Loss() == alone.Loss());
  CHECK(team.gradient == alone.gradient);
  if (!shared_input) return;
  CHECK(std::ranges::equal(team.InputGradient().values(), alone.InputGradient().values()));
}

TEST_CASE("a smaller batch than the workspace's gives the same columns") {
  Fixture f(Shape(2, 1, Activation::kRelu), /*shared_input=*/true);
  f.Loss();
  const double expected = f.workspace.output()(1, 1);
  const MatrixView<double> output =
      MlpForward<double>(f.layout, f.parameters, f.input.view(2), f.workspace);
  CHECK(output.columns == 2);
  CHECK(output(1, 1) == Approx(expected).epsilon(1e-12));
}

TEST_CASE("NaN in an input reaches the output instead of dying in an activation") {
  const Activation activation = GENERATE(Activation::kRelu, Activation::kSwish);
  Fixture f(Shape(1, 1, activation), /*shared_input=*/true);
  f.input.view()(2, 3) = std::numeric_limits<double>::quiet_NaN();
  f.Loss();
  CHECK(std::isnan(f.workspace.output()(0, 3)));
  CHECK(std::isfinite(f.workspace.output()(0, 2)));
}

TEST_CASE("initial weights stay inside the bound of their layer and fill it") {
  const MlpLayout layout({.members = 2, .inputs = 100, .hidden = {50}, .outputs = 10});
  std::vector<float> parameters(layout.size());
  Rng rng(5, "mlp-test");
  const auto initialization =
      GENERATE(Initialization::kTorchUniform, Initialization::kTruncatedNormal);
  layout.Initialize<float>(initialization, rng, parameters);
  const MlpLayout::Layer& first = layout.layers()[0];
  double square = 0;
  for (int64_t i = 0; i < first.weight_size; ++i) {
    const double weight = parameters[first.weight + i];
    CHECK(std::abs(weight) <= 0.1);  // 1 / sqrt(100); two deviations of the normal are the same
    square += weight * weight;
  }
  // Variances b^2 / 3 and (b / 2)^2 * 0.774 (cut at two deviations); 10,000 draws: 5 % is far out.
  const double expected =
      initialization == Initialization::kTorchUniform ? 0.01 / 3 : 0.0025 * 0.7737;
  CHECK(square / static_cast<double>(first.weight_size) == Approx(expected).epsilon(0.05));
}

}  // namespace
}  // namespace b4mrl
