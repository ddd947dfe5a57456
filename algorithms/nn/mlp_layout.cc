#include "algorithms/nn/mlp_layout.h"

#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "algorithms/nn/orthogonal.h"

namespace b4mrl {
namespace {

constexpr int64_t kCacheLineScalars = 16;  // floats

int64_t RoundUp(int64_t size) {
  return (size + kCacheLineScalars - 1) / kCacheLineScalars * kCacheLineScalars;
}

}  // namespace

MlpLayout::MlpLayout(MlpShape shape) : shape_(std::move(shape)) {
  std::vector<int> widths = shape_.hidden;
  widths.push_back(shape_.outputs);
  int inputs = shape_.inputs;
  for (const int outputs : widths) {
    Layer layer{.inputs = inputs,
                .outputs = outputs,
                .weight = size_,
                .bias = 0,
                .weight_size = static_cast<int64_t>(shape_.members) * outputs * inputs,
                .bias_size = static_cast<int64_t>(shape_.members) * outputs};
    layer.bias = layer.weight + RoundUp(layer.weight_size);
    size_ = layer.bias + RoundUp(layer.bias_size);
    layers_.push_back(layer);
    inputs = outputs;
  }
}

template <typename Scalar>
void MlpLayout::Initialize(Initialization initialization, Rng& rng,
                           std::span<Scalar> parameters) const {
  if (initialization == Initialization::kOrthogonal) {
    InitializeOrthogonal<Scalar>(*this, std::numbers::sqrt2, rng, parameters);
    return;
  }
  for (const Layer& layer : layers_) {
    const double bound = 1 / std::sqrt(static_cast<double>(layer.inputs));
    const std::span<Scalar> weight = parameters.subspan(layer.weight, layer.weight_size);
    const std::span<Scalar> bias = parameters.subspan(layer.bias, layer.bias_size);
    if (initialization == Initialization::kTorchUniform) {
      for (Scalar& value : weight) value = static_cast<Scalar>(rng.Uniform(-bound, bound));
      for (Scalar& value : bias) value = static_cast<Scalar>(rng.Uniform(-bound, bound));
      continue;
    }
    for (Scalar& value : weight) {
      double normal = rng.Normal();
      while (std::abs(normal) > 2) normal = rng.Normal();
      value = static_cast<Scalar>(0.5 * bound * normal);
    }
    for (Scalar& value : bias) value = 0;
  }
}

template <typename Scalar>
void MlpLayout::InitializeHead(double gain, Rng& rng, std::span<Scalar> parameters) const {
  const Layer& head = layers_.back();
  const double bound = gain * std::sqrt(6.0 / (head.inputs + head.outputs));
  for (Scalar& value : parameters.subspan(head.weight, head.weight_size)) {
    value = static_cast<Scalar>(rng.Uniform(-bound, bound));
  }
  for (Scalar& value : parameters.subspan(head.bias, head.bias_size)) value = 0;
}

template <typename Scalar>
void MlpLayout::Visit(std::string_view prefix, std::span<Scalar> parameters,
                      const ArrayVisitor<Scalar>& visitor) const {
  for (size_t i = 0; i < layers_.size(); ++i) {
    const Layer& layer = layers_[i];
    const std::string name = std::string(prefix) + "/layer" + std::to_string(i);
    std::vector<int> shape = {layer.outputs, layer.inputs};
    std::vector<int> bias_shape = {layer.outputs};
    if (shape_.members > 1) {
      shape.insert(shape.begin(), shape_.members);
      bias_shape.insert(bias_shape.begin(), shape_.members);
    }
    visitor({name + "/weight", shape, parameters.subspan(layer.weight, layer.weight_size)});
    visitor({name + "/bias", bias_shape, parameters.subspan(layer.bias, layer.bias_size)});
  }
}

#define B4MRL_INSTANTIATE(Scalar)                                                             \
  template void MlpLayout::Initialize<Scalar>(Initialization, Rng&, std::span<Scalar>) const; \
  template void MlpLayout::InitializeHead<Scalar>(double, Rng&, std::span<Scalar>) const;     \
  template void MlpLayout::Visit<Scalar>(std::string_view, std::span<Scalar>,                 \
                                         const ArrayVisitor<Scalar>&) const;
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
