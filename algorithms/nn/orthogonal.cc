#include "algorithms/nn/orthogonal.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace b4mrl {
namespace {

using Vector = std::vector<double>;

double Dot(const Vector& a, const Vector& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

// Draws `count` orthonormal vectors, uniformly distributed: normal vectors, orthonormalised one
// after the other (Gram-Schmidt).
std::vector<Vector> OrthonormalVectors(int count, int size, Rng& rng) {
  std::vector<Vector> vectors(count, Vector(size));
  for (int k = 0; k < count; ++k) {
    Vector& vector = vectors[k];
    rng.FillNormal(std::span<double>(vector));
    // A second pass removes the components that rounding left after the first pass.
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < k; ++j) {
        const double share = Dot(vector, vectors[j]);
        for (int i = 0; i < size; ++i) vector[i] -= share * vectors[j][i];
      }
    }
    const double length = std::sqrt(Dot(vector, vector));
    for (double& value : vector) value /= length;
  }
  return vectors;
}

// Makes one weight, which is row-major with outputs x inputs numbers, orthogonal times `gain`.
template <typename Scalar>
void FillOrthogonal(int outputs, int inputs, double gain, Rng& rng, Scalar* weight) {
  const bool by_rows = outputs <= inputs;
  const std::vector<Vector> vectors =
      OrthonormalVectors(std::min(outputs, inputs), std::max(outputs, inputs), rng);
  for (int row = 0; row < outputs; ++row) {
    for (int column = 0; column < inputs; ++column) {
      const double value = by_rows ? vectors[row][column] : vectors[column][row];
      weight[static_cast<int64_t>(row) * inputs + column] = static_cast<Scalar>(gain * value);
    }
  }
}

}  // namespace

template <typename Scalar>
void InitializeOrthogonal(const MlpLayout& layout, double gain, Rng& rng,
                          std::span<Scalar> parameters) {
  for (const MlpLayout::Layer& layer : layout.layers()) {
    const int64_t size = static_cast<int64_t>(layer.outputs) * layer.inputs;
    for (int member = 0; member < layout.members(); ++member) {
      FillOrthogonal(layer.outputs, layer.inputs, gain, rng,
                     parameters.data() + layer.weight + member * size);
    }
    std::ranges::fill(parameters.subspan(layer.bias, layer.bias_size), Scalar(0));
  }
}

template void InitializeOrthogonal<float>(const MlpLayout&, double, Rng&, std::span<float>);
template void InitializeOrthogonal<double>(const MlpLayout&, double, Rng&, std::span<double>);

}  // namespace b4mrl
