#include "algorithms/nn/mlp.h"

#include <algorithm>

#include "algorithms/nn/elementwise.h"
#include "algorithms/nn/products/left_factor.h"

namespace b4mrl {
namespace {

// A member's weights as a column-major matrix: inputs x outputs.
template <typename Scalar>
MatrixView<Scalar> WeightView(const MlpLayout::Layer& layer, Scalar* parameters, int member) {
  const int64_t size = static_cast<int64_t>(layer.outputs) * layer.inputs;
  return {parameters + layer.weight + member * size, layer.inputs, layer.outputs};
}

template <typename Scalar>
std::span<Scalar> BiasSpan(const MlpLayout::Layer& layer, Scalar* parameters, int member) {
  return {parameters + layer.bias + static_cast<int64_t>(member) * layer.outputs,
          static_cast<size_t>(layer.outputs)};
}

// A member's rows of `input`, or the whole input if the members share it.
template <typename Scalar>
MatrixView<const Scalar> InputBlock(const MlpLayout& layout, MatrixView<const Scalar> input,
                                    int m) {
  const int inputs = layout.shape().inputs;
  return input.rows == inputs ? input : input.RowBlock(m * inputs, inputs);
}

// The first `columns` columns of a member's block of one of the workspace's per-layer buffers, as
// nn/mlp.h lays them out.
template <typename Scalar>
MatrixView<Scalar> MemberBlock(const MlpLayout& layout, MlpWorkspace<Scalar>& workspace,
                               std::vector<MatrixBuffer<Scalar>>& buffers, size_t layer, int m,
                               int columns) {
  const int outputs = layout.layers()[layer].outputs;
  const MatrixView<Scalar> buffer = buffers[layer].view();
  if (layer + 1 == layout.layers().size()) {
    return buffer.RowBlock(m * outputs, outputs).ColumnBlock(0, columns);
  }
  return buffer.ColumnBlock(m * (buffer.columns / workspace.members), columns);
}

// What determines the derivative of hidden layer `index`'s activation: swish's slopes, or ReLU's
// outputs.
template <typename Scalar>
MatrixView<Scalar> DerivativeBlock(const MlpLayout& layout, MlpWorkspace<Scalar>& workspace,
                                   size_t index, int m, int columns) {
  const bool swish = layout.shape().activation == Activation::kSwish;
  return MemberBlock(layout, workspace, swish ? workspace.slopes : workspace.activations, index, m,
                     columns);
}

// The precision of products with layer `index`'s weight, whose factors are rounded where both its
// sides are hidden layers.
template <typename Scalar>
Precision PrecisionOf(const MlpLayout& layout, const MlpWorkspace<Scalar>& workspace,
                      size_t index) {
  const bool hidden = index > 0 && index + 1 < layout.layers().size();
  return hidden ? workspace.precision : Precision::kFp32;
}

// Reserves memory for the products with layer `index`'s weight in passes over `batch` columns.
template <typename Scalar>
void ReserveScratch(const MlpLayout& layout, size_t index, int batch,
                    MlpWorkspace<Scalar>& workspace) {
  const int inputs = layout.layers()[index].inputs, outputs = layout.layers()[index].outputs;
  const Precision precision = PrecisionOf(layout, workspace, index);
  for (ProductScratch<Scalar>& scratch : workspace.scratch) {
    scratch.Reserve(precision, outputs, inputs, batch);  // forward
    if (precision == Precision::kFp32) continue;         // prepares nothing in backward passes
    scratch.Reserve(precision, inputs, outputs, batch);  // to the layer below
    scratch.Reserve(precision, inputs, batch, outputs);  // to the weight
  }
}

// Adds the bias and applies the activation of layer `index` to some columns of its output.
template <typename Scalar>
void Activate(const MlpLayout& layout, size_t index, std::span<const Scalar> bias,
              MatrixView<Scalar> output, MatrixView<Scalar> slopes) {
  if (index + 1 == layout.layers().size()) {
    AddBias<Scalar>(bias, output);
  } else if (layout.shape().activation == Activation::kRelu) {
    AddBiasRelu<Scalar>(bias, output);
  } else {
    AddBiasSwish<Scalar>(bias, output, slopes);
  }
}

// The forward pass of layer `index` for one member.
template <typename Scalar>
void ForwardLayer(const MlpLayout& layout, const Scalar* parameters, int member, int m,
                  size_t index, MatrixView<const Scalar> below, MlpWorkspace<Scalar>& workspace,
                  int thread) {
  const MlpLayout::Layer& layer = layout.layers()[index];
  const int columns = workspace.batch;
  const MatrixView<Scalar> output =
      MemberBlock(layout, workspace, workspace.activations, index, m, columns);
  const bool keeps_slopes = index < workspace.slopes.size();
  const MatrixView<Scalar> slopes =
      keeps_slopes ? MemberBlock(layout, workspace, workspace.slopes, index, m, columns) : output;
  const LeftFactor<Scalar> weight(PrecisionOf(layout, workspace, index),
                                  WeightView(layer, parameters, member), Transpose::kYes,
                                  workspace.scratch[thread]);
  const int step = weight.ColumnsAtOnce(columns);
  for (int first = 0; first < columns; first += step) {
    const int count = std::min(step, columns - first);
    const MatrixView<Scalar> block = output.ColumnBlock(first, count);
    weight.Multiply(below.ColumnBlock(first, count), Transpose::kNo, block);
    Activate<Scalar>(layout, index, BiasSpan(layer, parameters, member), block,
                     keeps_slopes ? slopes.ColumnBlock(first, count) : MatrixView<Scalar>());
  }
}

template <typename Scalar>
void ForwardMember(const MlpLayout& layout, const Scalar* parameters, int first_member, int m,
                   MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace, int thread) {
  MatrixView<const Scalar> below = InputBlock(layout, input, m);
  for (size_t i = 0; i < layout.layers().size(); ++i) {
    ForwardLayer(layout, parameters, first_member + m, m, i, below, workspace, thread);
    below = MemberBlock(layout, workspace, workspace.activations, i, m, workspace.batch);
  }
}

// The backward pass through layer `index`: from d loss / d its output to d loss / d the output of
// the layer below, before the activation, for the first `columns` columns. If `bias_gradient` is
// not empty, writes d loss / d the bias of the layer below, too.
template <typename Scalar>
void BackwardToHidden(const MlpLayout& layout, const Scalar* parameters, int member, int m,
                      size_t index, int columns, MlpWorkspace<Scalar>& workspace, int thread,
                      std::span<Scalar> bias_gradient) {
  const MlpLayout::Layer& layer = layout.layers()[index];
  const MatrixView<Scalar> from =
      MemberBlock(layout, workspace, workspace.gradients, index, m, columns);
  const MatrixView<Scalar> to =
      MemberBlock(layout, workspace, workspace.gradients, index - 1, m, columns);
  const bool swish = layout.shape().activation == Activation::kSwish;
  const MatrixView<const Scalar> kept = DerivativeBlock(layout, workspace, index - 1, m, columns);
  const MatrixView<const Scalar> weight = WeightView(layer, parameters, member);
  const LeftFactor<Scalar> factor(PrecisionOf(layout, workspace, index), weight, Transpose::kNo,
                                  workspace.scratch[thread]);
  std::fill(bias_gradient.begin(), bias_gradient.end(), Scalar(0));
  const int step = factor.ColumnsAtOnce(columns);
  for (int first = 0; first < columns; first += step) {
    const int count = std::min(step, columns - first);
    const MatrixView<const Scalar> above = from.ColumnBlock(first, count);
    const MatrixView<const Scalar> seen = kept.ColumnBlock(first, count);
    const MatrixView<Scalar> block = to.ColumnBlock(first, count);
    if (!swish && layer.outputs == 1) {
      ReluBackwardOuter<Scalar>(seen, weight.data, above.data, above.stride, block);
    } else {
      factor.Multiply(above, Transpose::kNo, block);
      if (swish) MultiplyInPlace<Scalar>(seen, block);
      if (!swish) ReluBackward<Scalar>(seen, block);
    }
    if (!bias_gradient.empty()) AddRowSums<Scalar>(block, bias_gradient);
  }
}

template <typename Scalar>
void BackwardMember(const MlpLayout& layout, const Scalar* parameters, int first_member, int m,
                    MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace, int thread,
                    Scalar* parameter_gradient) {
  const int member = first_member + m;
  const int columns = workspace.batch;
  const size_t last = layout.layers().size() - 1;
  const auto gradient = [&](size_t i) {
    return MemberBlock(layout, workspace, workspace.gradients, i, m, columns);
  };
  const auto bias_gradient = [&](size_t i) {
    return BiasSpan(layout.layers()[i], parameter_gradient, member);
  };
  std::ranges::fill(bias_gradient(last), Scalar(0));
  AddRowSums<Scalar>(gradient(last), bias_gradient(last));
  for (size_t i = last + 1; i-- > 0;) {
    const MatrixView<const Scalar> below =
        i == 0 ? InputBlock(layout, input, m)
               : MemberBlock(layout, workspace, workspace.activations, i - 1, m, columns);
    LeftFactor<Scalar>(PrecisionOf(layout, workspace, i), below, Transpose::kNo,
                       workspace.scratch[thread])
        .Multiply(gradient(i), Transpose::kYes,
                  WeightView(layout.layers()[i], parameter_gradient, member));
    if (i == 0) break;
    BackwardToHidden(layout, parameters, member, m, i, columns, workspace, thread,
                     bias_gradient(i - 1));
  }
}

// Moves the columns numbered `kept`, in ascending order, to the front.
template <typename Scalar>
void MoveToFront(std::span<const int> kept, MatrixView<Scalar> matrix) {
  for (int i = 0; i < std::ssize(kept); ++i) {
    if (kept[i] != i) std::copy_n(matrix.column(kept[i]), matrix.rows, matrix.column(i));
  }
}

// Finds the columns of the batch in which the member's output gradient is not 0, and moves them to
// the front of the member's blocks, as far as BackwardToHidden reads these. Returns the columns'
// numbers.
template <typename Scalar>
std::span<const int> KeepColumnsWithGradient(const MlpLayout& layout, int m,
                                             MlpWorkspace<Scalar>& workspace) {
  const size_t last = layout.layers().size() - 1;
  const int columns = workspace.batch;
  const MatrixView<Scalar> gradient =
      MemberBlock(layout, workspace, workspace.gradients, last, m, columns);
  std::vector<int>& kept = workspace.kept[m];
  kept.clear();
  for (int i = 0; i < columns; ++i) {
    const Scalar* column = gradient.column(i);
    const auto is_zero = [](Scalar value) { return value == 0; };
    if (!std::all_of(column, column + gradient.rows, is_zero)) kept.push_back(i);
  }
  MoveToFront<Scalar>(kept, gradient);
  for (size_t i = 0; i < last; ++i) {
    MoveToFront<Scalar>(kept, DerivativeBlock(layout, workspace, i, m, columns));
  }
  return kept;
}

}  // namespace

template <typename Scalar>
MlpWorkspace<Scalar>::MlpWorkspace(const MlpLayout& layout, const MlpWorkspaceOptions& options)
    : members(options.members),
      precision(options.precision),
      team(std::make_shared<ThreadTeam>(std::min(options.threads, options.members))),
      scratch(team->threads()) {
  const int batch_max = options.batch_max;
  const size_t last = layout.layers().size() - 1;
  for (size_t i = 0; i <= last; ++i) {
    const int width = layout.layers()[i].outputs;
    ReserveScratch(layout, i, batch_max, *this);
    const int rows = i == last ? members * width : width;
    const int columns = i == last ? batch_max : members * batch_max;
    activations.emplace_back(rows, columns);
    if (!options.keep_gradients) continue;
    gradients.emplace_back(rows, columns);
    if (i < last && layout.shape().activation == Activation::kSwish) {
      slopes.emplace_back(rows, columns);
    }
  }
  if (!options.keep_gradients) return;
  input_gradient = MatrixBuffer<Scalar>(layout.shape().inputs, batch_max);
  kept.resize(members);
  for (std::vector<int>& columns : kept) columns.reserve(batch_max);
}

template <typename Scalar>
MatrixView<Scalar> MlpForward(const MlpLayout& layout, std::span<const Scalar> parameters,
                              MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                              int first_member) {
  workspace.batch = input.columns;
  workspace.team->ForEach(workspace.members, [&](int m, int thread) {
    ForwardMember(layout, parameters.data(), first_member, m, input, workspace, thread);
  });
  return workspace.output();
}

template <typename Scalar>
void MlpBackward(const MlpLayout& layout, std::span<const Scalar> parameters,
                 MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                 std::span<Scalar> parameter_gradient, int first_member) {
  workspace.team->ForEach(workspace.members, [&](int m, int thread) {
    BackwardMember(layout, parameters.data(), first_member, m, input, workspace, thread,
                   parameter_gradient.data());
  });
}

template <typename Scalar>
void MlpBackwardToInput(const MlpLayout& layout, std::span<const Scalar> parameters, int first_row,
                        MlpWorkspace<Scalar>& workspace, MatrixView<Scalar> input_gradient,
                        int first_member) {
  workspace.team->ForEach(workspace.members, [&](int m, int thread) {
    const int columns = static_cast<int>(KeepColumnsWithGradient(layout, m, workspace).size());
    for (size_t i = layout.layers().size() - 1; i > 0; --i) {
      BackwardToHidden<Scalar>(layout, parameters.data(), first_member + m, m, i, columns,
                               workspace, thread, {});
    }
  });
  for (int i = 0; i < input_gradient.columns; ++i) {
    std::fill_n(input_gradient.column(i), input_gradient.rows, Scalar(0));
  }
  for (int m = 0; m < workspace.members; ++m) {
    const std::vector<int>& kept = workspace.kept[m];
    const int columns = static_cast<int>(kept.size());
    const MatrixView<Scalar> part(workspace.input_gradient.values().data(), input_gradient.rows,
                                  columns);
    const MatrixView<const Scalar> weight =
        WeightView(layout.layers()[0], parameters.data(), first_member + m);
    Multiply<Scalar>(weight.RowBlock(first_row, part.rows), Transpose::kNo,
                     MemberBlock(layout, workspace, workspace.gradients, 0, m, columns),
                     Transpose::kNo, part);
    for (int i = 0; i < columns; ++i) {
      Scalar* to = input_gradient.column(kept[i]);
      for (int row = 0; row < part.rows; ++row) to[row] += part(row, i);
    }
  }
}

#define B4MRL_INSTANTIATE(Scalar)                                                                 \
  template struct MlpWorkspace<Scalar>;                                                           \
  template MatrixView<Scalar> MlpForward<Scalar>(const MlpLayout&, std::span<const Scalar>,       \
                                                 MatrixView<const Scalar>, MlpWorkspace<Scalar>&, \
                                                 int);                                            \
  template void MlpBackward<Scalar>(const MlpLayout&, std::span<const Scalar>,                    \
                                    MatrixView<const Scalar>, MlpWorkspace<Scalar>&,              \
                                    std::span<Scalar>, int);                                      \
  template void MlpBackwardToInput<Scalar>(const MlpLayout&, std::span<const Scalar>, int,        \
                                           MlpWorkspace<Scalar>&, MatrixView<Scalar>, int);
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
