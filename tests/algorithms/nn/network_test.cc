#include "algorithms/nn/network.h"

#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/algorithms/finite_differences.h"

namespace b4mrl {
namespace {

constexpr int kInputs = 3;
constexpr int kBatch = 5;

// Two members with two outputs each, a target, and one number behind the layers.
NetworkOptions Options() {
  return {.shape = {.members = 2, .inputs = kInputs, .hidden = {6, 7, 5}, .outputs = 2},
          .learning_rate = 0.1,
          .batch_max = kBatch,
          .has_target = true,
          .scalars = 1,
          .scalars_name = "scale",
          .weights = {Rng(1, "network-test")}};
}

MatrixBuffer<double> Input() {
  MatrixBuffer<double> input(kInputs, kBatch);
  Rng rng(2, "network-test");
  rng.FillNormal(input.values());
  return input;
}

// The sum of squared outputs, half; leaves its gradient in the workspace.
double Loss(Network<double>& network, MatrixView<const double> input) {
  const MatrixView<double> output = network.Forward(input);
  double loss = 0;
  for (int i = 0; i < output.columns; ++i) {
    for (int k = 0; k < output.rows; ++k) {
      network.workspace.output_gradient()(k, i) = output(k, i);
      loss += 0.5 * output(k, i) * output(k, i);
    }
  }
  return loss;
}

TEST_CASE("a network's gradients are those of its weights and of its input") {
  Network<double> network(Options());
  MatrixBuffer<double> input = Input();
  const auto loss = [&] { return Loss(network, input.view()); };
  loss();
  network.Backward(input.view());
  const std::vector<double> gradient(network.gradient.begin(), network.gradient.end());
  CheckGradient(network.values, gradient, loss, 60);

  loss();
  MatrixBuffer<double> input_gradient(kInputs, kBatch);
  network.BackwardToInput(0, input_gradient.view());
  CheckGradient(input.values(), input_gradient.values(), loss);
  CHECK(std::vector<double>(network.gradient.begin(), network.gradient.end()) == gradient);
}

TEST_CASE("a step trains the layers and the number behind them, and the target follows") {
  Network<double> network(Options());
  const MatrixBuffer<double> input = Input();
  const AlignedVector<double> before = network.values;
  CHECK(network.target == before);
  Loss(network, input.view());
  network.Backward(input.view());
  network.scalar_gradient()[0] = -1;
  network.StepWithTarget(0.25);
  // Adam's first step is the learning rate long, but for epsilon.
  CHECK(network.scalars()[0] == Approx(0.1).epsilon(1e-6));
  CHECK(network.values[0] != before[0]);
  for (size_t i = 0; i < before.size(); ++i) {
    CHECK(network.target[i] ==
          Approx(0.75 * before[i] + 0.25 * network.values[i]).epsilon(0).margin(1e-12));
  }
  network.ForwardTarget(input.view());
  const double target_output = network.workspace.output()(0, 0);
  network.target = network.values;
  CHECK(network.Forward(input.view())(0, 0) != target_output);
  CHECK(network.ForwardTarget(input.view())(0, 0) == network.Forward(input.view())(0, 0));
}

TEST_CASE("a network shows all its state under names of its own") {
  Network<double> network(Options());
  std::set<std::string> names;
  network.Visit("critic", [&](const NamedArray<double>& array) { names.insert(array.name); });
  for (int layer = 0; layer < 4; ++layer) {
    for (const std::string name : {"critic", "critic_target"}) {
      CHECK(names.contains(name + "/layer" + std::to_string(layer) + "/weight"));
      CHECK(names.contains(name + "/layer" + std::to_string(layer) + "/bias"));
    }
  }
  CHECK(names.contains("critic/scale"));
  CHECK(names.contains("critic/adam/first_moment"));
  CHECK(names.contains("critic/adam/second_moment"));
  CHECK(names.size() == 19);
}

TEST_CASE("numbers that Adam trains move against their gradient") {
  TrainedVector<double> numbers(2, 0.5);
  numbers.gradient = {3, -2};
  numbers.Step();
  CHECK(numbers.values[0] == Approx(-0.5).epsilon(1e-6));
  CHECK(numbers.values[1] == Approx(0.5).epsilon(1e-6));
}

}  // namespace
}  // namespace b4mrl
