#include "algorithms/nn/orthogonal.h"

#include <catch2/catch.hpp>

#include "algorithms/nn/products/view.h"

namespace b4mrl {
namespace {

TEST_CASE("orthogonal weights have orthogonal rows or columns of the length asked for") {
  // Fewer outputs than inputs, more, as many, and one.
  const MlpLayout layout({.members = 2, .inputs = 6, .hidden = {4, 9, 9}, .outputs = 1});
  AlignedVector<double> parameters(layout.size(), 7.0);
  Rng rng(1, "orthogonal-test");
  InitializeOrthogonal<double>(layout, 1.5, rng, parameters);
  for (const MlpLayout::Layer& layer : layout.layers()) {
    const int64_t size = static_cast<int64_t>(layer.outputs) * layer.inputs;
    for (int member = 0; member < 2; ++member) {
      const double* weight = parameters.data() + layer.weight + member * size;
      const bool by_rows = layer.outputs <= layer.inputs;
      const int vectors = by_rows ? layer.outputs : layer.inputs;
      const int length = by_rows ? layer.inputs : layer.outputs;
      const auto at = [&](int vector, int i) {
        return by_rows ? weight[vector * layer.inputs + i] : weight[i * layer.inputs + vector];
      };
      for (int a = 0; a < vectors; ++a) {
        for (int b = 0; b <= a; ++b) {
          double product = 0;
          for (int i = 0; i < length; ++i) product += at(a, i) * at(b, i);
          // Two passes of Gram-Schmidt leave rounding errors alone.
          CHECK(product == Approx(a == b ? 1.5 * 1.5 : 0).epsilon(0).margin(1e-12));
        }
      }
    }
    for (int64_t i = 0; i < layer.bias_size; ++i) CHECK(parameters[layer.bias + i] == 0);
  }
  const MlpLayout::Layer& first = layout.layers()[0];
  CHECK(parameters[first.weight] != parameters[first.weight + first.outputs * first.inputs]);
}

}  // namespace
}  // namespace b4mrl
