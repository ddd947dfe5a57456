#include "algorithms/nn/mlp.h"

#include <cmath>
#include <string>

#include "algorithms/nn/blas.h"
#include "algorithms/nn/elementwise.h"

namespace b4mrl {
namespace {

constexpr int64_t kCacheLineScalars = 16;  // floats

int64_t RoundUp(int64_t size) {
  return (size + kCacheLineScalars - 1) / kCacheLineScalars * kCacheLineScalars;
}

// Weights of `count` members from `member` on, seen column-major: inputs x (count * outputs).
template <typename Scalar>
MatrixView<Scalar> WeightView(const MlpLayout::Layer& layer, Scalar* parameters, int member,
                              int count) {
  const int64_t member_size = static_cast<int64_t>(layer.outputs) * layer.inputs;
  return {parameters + layer.weight + member * member_size, layer.inputs, count * layer.outputs};
}

template <typename Scalar>
std::span<Scalar> BiasSpan(const MlpLayout::Layer& layer, Scalar* parameters, int member,
                           int count) {
  return {parameters + layer.bias + static_cast<int64_t>(member) * layer.outputs,
          static_cast<size_t>(count) * layer.outputs};
}

// Whether all members of a layer read the same rows, so that one product serves them.
template <typename Scalar>
bool InputIsShared(const MlpLayout::Layer& layer, MatrixView<const Scalar> input) {
  return input.rows == layer.inputs;
}

template <typename Scalar>
void ForwardProducts(const MlpLayout::Layer& layer, const Scalar* parameters, int first_member,
                     int members, MatrixView<const Scalar> input, MatrixView<Scalar> output) {
  if (InputIsShared(layer, input)) {
    Multiply<Scalar>(WeightView(layer, parameters, first_member, members), Transpose::kYes, input,
                     Transpose::kNo, output);
    return;
  }
  for (int m = 0; m < members; ++m) {
    Multiply<Scalar>(WeightView(layer, parameters, first_member + m, 1), Transpose::kYes,
                     input.RowBlock(m * layer.inputs, layer.inputs), Transpose::kNo,
                     output.RowBlock(m * layer.outputs, layer.outputs));
  }
}

template <typename Scalar>
void ParameterGradients(const MlpLayout::Layer& layer, MatrixView<const Scalar> input,
                        MatrixView<const Scalar> output_gradient, int members,
                        Scalar* parameter_gradient) {
  RowSums<Scalar>(output_gradient, BiasSpan(layer, parameter_gradient, 0, members));
  if (InputIsShared(layer, input)) {
    Multiply<Scalar>(input, Transpose::kNo, output_gradient, Transpose::kYes,
                     WeightView(layer, parameter_gradient, 0, members));
    return;
  }
  for (int m = 0; m < members; ++m) {
    Multiply<Scalar>(input.RowBlock(m * layer.inputs, layer.inputs), Transpose::kNo,
                     output_gradient.RowBlock(m * layer.outputs, layer.outputs), Transpose::kYes,
                     WeightView(layer, parameter_gradient, m, 1));
  }
}

// From d loss / d output of layer `index` to that of the layer below, before its bias.
template <typename Scalar>
void BackwardToHidden(const MlpLayout& layout, const Scalar* parameters, int first_member,
                      size_t index, MlpWorkspace<Scalar>& workspace) {
  const MlpLayout::Layer& layer = layout.layers()[index];
  const bool relu = layout.shape().activation == Activation::kRelu;
  const MatrixView<const Scalar> from = workspace.gradients[index].view(workspace.batch);
  const MatrixView<const Scalar> activation =
      workspace.activations[index - 1].view(workspace.batch);
  const MatrixView<Scalar> to = workspace.gradients[index - 1].view(workspace.batch);
  for (int m = 0; m < workspace.members; ++m) {
    const int first_row = m * layer.inputs;
    const MatrixView<const Scalar> weight = WeightView(layer, parameters, first_member + m, 1);
    if (relu && layer.outputs == 1) {
      ReluBackwardOuter<Scalar>(activation.RowBlock(first_row, layer.inputs), weight.data,
                                from.data + m, from.stride, to.RowBlock(first_row, layer.inputs));
    } else {
      Multiply<Scalar>(weight, Transpose::kNo, from.RowBlock(m * layer.outputs, layer.outputs),
                       Transpose::kNo, to.RowBlock(first_row, layer.inputs));
    }
  }
  if (!relu) {
    MultiplyInPlace<Scalar>(workspace.slopes[index - 1].view(workspace.batch), to);
  } else if (layer.outputs != 1) {
    ReluBackward<Scalar>(activation, to);
  }
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

template <typename Scalar>
MlpWorkspace<Scalar>::MlpWorkspace(const MlpLayout& layout, int member_count, int batch_max,
                                   bool keep_gradients)
    : members(member_count) {
  for (const MlpLayout::Layer& layer : layout.layers()) {
    const int rows = members * layer.outputs;
    const bool hidden = activations.size() + 1 < layout.layers().size();
    activations.emplace_back(rows, batch_max);
    if (!keep_gradients) continue;
    gradients.emplace_back(rows, batch_max);
    if (hidden && layout.shape().activation == Activation::kSwish) {
      slopes.emplace_back(rows, batch_max);
    }
  }
}

template <typename Scalar>
MatrixView<Scalar> MlpForward(const MlpLayout& layout, std::span<const Scalar> parameters,
                              MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                              int first_member) {
  workspace.batch = input.columns;
  const size_t last = layout.layers().size() - 1;
  MatrixView<const Scalar> below = input;
  for (size_t i = 0; i <= last; ++i) {
    const MlpLayout::Layer& layer = layout.layers()[i];
    const MatrixView<Scalar> output = workspace.activations[i].view(workspace.batch);
    ForwardProducts(layer, parameters.data(), first_member, workspace.members, below, output);
    const std::span<const Scalar> bias =
        BiasSpan(layer, parameters.data(), first_member, workspace.members);
    if (i == last) {
      AddBias<Scalar>(bias, output);
    } else if (layout.shape().activation == Activation::kRelu) {
      AddBiasRelu<Scalar>(bias, output);
    } else {
      AddBiasSwish<Scalar>(bias, output,
                           workspace.slopes.empty() ? MatrixView<Scalar>()
                                                    : workspace.slopes[i].view(workspace.batch));
    }
    below = output;
  }
  return workspace.output();
}

template <typename Scalar>
void MlpBackward(const MlpLayout& layout, std::span<const Scalar> parameters,
                 MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                 std::span<Scalar> parameter_gradient, int first_member) {
  for (size_t i = layout.layers().size(); i-- > 0;) {
    if (!parameter_gradient.empty()) {
      const MatrixView<const Scalar> below =
          i == 0 ? input : workspace.activations[i - 1].view(workspace.batch);
      ParameterGradients<Scalar>(layout.layers()[i], below,
                                 workspace.gradients[i].view(workspace.batch), workspace.members,
                                 parameter_gradient.data());
    }
    if (i > 0) BackwardToHidden(layout, parameters.data(), first_member, i, workspace);
  }
}

template <typename Scalar>
void MlpInputGradient(const MlpLayout& layout, std::span<const Scalar> parameters, int first_row,
                      MlpWorkspace<Scalar>& workspace, MatrixView<Scalar> input_gradient,
                      int first_member) {
  const MatrixView<const Scalar> weight =
      WeightView(layout.layers()[0], parameters.data(), first_member, workspace.members);
  Multiply<Scalar>(weight.RowBlock(first_row, input_gradient.rows), Transpose::kNo,
                   workspace.gradients[0].view(workspace.batch), Transpose::kNo, input_gradient);
}

#define B4MRL_INSTANTIATE(Scalar)                                                                 \
  template void MlpLayout::Initialize<Scalar>(Initialization, Rng&, std::span<Scalar>) const;     \
  template void MlpLayout::Visit<Scalar>(std::string_view, std::span<Scalar>,                     \
                                         const ArrayVisitor<Scalar>&) const;                      \
  template struct MlpWorkspace<Scalar>;                                                           \
  template MatrixView<Scalar> MlpForward<Scalar>(const MlpLayout&, std::span<const Scalar>,       \
                                                 MatrixView<const Scalar>, MlpWorkspace<Scalar>&, \
                                                 int);                                            \
  template void MlpBackward<Scalar>(const MlpLayout&, std::span<const Scalar>,                    \
                                    MatrixView<const Scalar>, MlpWorkspace<Scalar>&,              \
                                    std::span<Scalar>, int);                                      \
  template void MlpInputGradient<Scalar>(const MlpLayout&, std::span<const Scalar>, int,          \
                                         MlpWorkspace<Scalar>&, MatrixView<Scalar>, int);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
