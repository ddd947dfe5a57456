// Networks whose products between hidden layers are in bf16, against the same networks in float64,
// whose gradients mlp_test.cc compares with finite differences.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "algorithms/nn/mlp.h"
#include "algorithms/nn/products/precision.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr int kBatch = 37;

MlpShape Shape(Activation activation) {
  return {
      .members = 2, .inputs = 5, .hidden = {37, 50, 29}, .outputs = 2, .activation = activation};
}

// Outputs and gradients of a network for the loss sum(weights * output). Parameters, input and
// weights are the same numbers for either Scalar.
template <typename Scalar>
struct Pass {
  explicit Pass(Activation activation, Precision precision = Precision::kFp32, int threads = 1)
      : layout(Shape(activation)),
        parameters(layout.size()),
        gradient(layout.size()),
        input(layout.shape().inputs, kBatch),
        input_gradient(2, kBatch),
        workspace(layout,
                  {.members = 2, .batch_max = kBatch, .threads = threads, .precision = precision}) {
    Draw("weights", parameters, 0.3);
    Draw("input", input.values(), 1);
    const MatrixView<Scalar> output =
        MlpForward<Scalar>(layout, parameters, input.view(), workspace);
    outputs.assign(output.values().begin(), output.values().end());
    Draw("output-gradient", workspace.output_gradient().values(), 1);
    MlpBackward<Scalar>(layout, parameters, input.view(), workspace, gradient);
    Draw("output-gradient", workspace.output_gradient().values(), 1);
    MlpBackwardToInput<Scalar>(layout, parameters, 1, workspace, input_gradient.view());
  }

  void Draw(std::string_view purpose, std::span<Scalar> numbers, double scale) {
    Rng rng(11, purpose);
    for (Scalar& number : numbers)
      number = static_cast<Scalar>(static_cast<float>(scale * rng.Normal()));
  }

  MlpLayout layout;
  AlignedVector<Scalar> parameters, gradient;
  MatrixBuffer<Scalar> input, input_gradient;
  MlpWorkspace<Scalar> workspace;
  std::vector<Scalar> outputs;
};

// Norm of the difference over the norm of `expected`.
double Deviation(std::span<const float> numbers, std::span<const double> expected) {
  REQUIRE(numbers.size() == expected.size());
  double difference = 0, norm = 0;
  for (size_t i = 0; i < numbers.size(); ++i) {
    difference += (numbers[i] - expected[i]) * (numbers[i] - expected[i]);
    norm += expected[i] * expected[i];
  }
  return std::sqrt(difference / norm);
}

}  // namespace

TEST_CASE("a bf16 network's outputs and gradients are the exact ones within the rounding") {
  if (!HasBf16()) {
    WARN("skipped: this processor has no AVX512-BF16");
    return;
  }
  const Activation activation = GENERATE(Activation::kRelu, Activation::kSwish);
  const Pass<double> exact(activation);
  const Pass<float> rounded(activation, Precision::kBf16);
  // A factor's rounding is at most 2^-8 = 0.4% and about 0.17% in the mean square. An output has
  // gone through two products with two rounded factors each, a gradient through up to five: five
  // times the mean square of ten roundings is 2.7%. About one sum in 300 lies so close to 0 that
  // the rounding may flip its ReLU, which changes that column by all of it: sqrt(1 / 300) = 6%.
  const double most = activation == Activation::kRelu ? 0.06 : 0.027;
  CHECK(Deviation(rounded.outputs, exact.outputs) < most);
  CHECK(Deviation(rounded.gradient, exact.gradient) < most);
  CHECK(Deviation(rounded.input_gradient.values(), exact.input_gradient.values()) < most);
  // The products were in bf16 indeed: fp32 is a thousand times as close.
  const Pass<float> fp32(activation);
  CHECK(Deviation(fp32.outputs, exact.outputs) < 1e-5);
  CHECK(Deviation(rounded.outputs, exact.outputs) > 1e-4);
}

TEST_CASE("threads change no bit of a bf16 network's outputs and gradients") {
  if (!HasBf16()) {
    WARN("skipped: this processor has no AVX512-BF16");
    return;
  }
  const Pass<float> alone(Activation::kSwish, Precision::kBf16, 1);
  const Pass<float> team(Activation::kSwish, Precision::kBf16, 2);
  REQUIRE(team.workspace.team->threads() == 2);
  CHECK(team.outputs == alone.outputs);
  CHECK(team.gradient == alone.gradient);
  CHECK(std::ranges::equal(team.input_gradient.values(), alone.input_gradient.values()));
}

}  // namespace b4mrl
