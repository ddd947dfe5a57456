// Multi-layer perceptrons: one network, or several networks of equal shape as members of one
// object. An actor has one member, twin critics have two, a dynamics ensemble has seven.
//
// MlpLayout says where each layer's numbers lie in one flat parameter buffer; gradients, targets
// and optimiser moments use the same layout, so Adam, Polyak averaging and checkpoints are one loop
// each. A weight is stored as PyTorch stores it, (outputs, inputs) row-major, and a layer's members
// follow each other.
//
// MlpWorkspace keeps activations from the forward pass for the backward pass; it is sized once, and
// passes allocate nothing. A pass takes one member after the other through all layers, so that a
// member's activations are still in the cache when its next layer reads them; for the same reason a
// member's hidden activations are one dense width x batch block. The output alone is stacked:
// (members * outputs) x batch, with member m in rows [m * outputs, (m + 1) * outputs). A workspace
// may have its own threads, which share out the members; their number changes no bit. nn/network.h
// bundles a layout and a workspace with weights and their optimiser. Thread rule: a layout is
// immutable; a workspace belongs to one thread at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/parameters.h"
#include "algorithms/nn/products/view.h"
#include "algorithms/nn/thread_team.h"
#include "proto/base/rng.h"

namespace b4mrl {

enum class Activation {
  kRelu,
  kSwish,  // x * sigmoid(x)
};

struct MlpShape {
  int members = 1;
  int inputs = 0;           // of one member
  std::vector<int> hidden;  // widths of one member, at least one
  int outputs = 0;          // of one member; the output layer is linear
  Activation activation = Activation::kRelu;
};

enum class Initialization {
  kTorchUniform,     // weight and bias ~ U(-1/sqrt(inputs), 1/sqrt(inputs)): torch.nn.Linear
  kTruncatedNormal,  // weight ~ N(0, 1/(4 inputs)) within two deviations, bias 0: MOPO's original
  kOrthogonal,       // nn/orthogonal.h with gain sqrt(2), bias 0: IQL's original
};

class MlpLayout {
 public:
  // Sizes of one layer, and the offsets of its arrays in a flat buffer, in numbers.
  struct Layer {
    int inputs;           // of one member
    int outputs;          // of one member
    int64_t weight;       // offset of the weight (members, outputs, inputs)
    int64_t bias;         // offset of the bias (members, outputs)
    int64_t weight_size;  // members * outputs * inputs
    int64_t bias_size;    // members * outputs
  };

  explicit MlpLayout(MlpShape shape);

  const MlpShape& shape() const { return shape_; }
  int members() const { return shape_.members; }
  const std::vector<Layer>& layers() const { return layers_; }
  // Length of a flat buffer. Arrays start on cache lines; gaps between them stay zero in updates.
  int64_t size() const { return size_; }

  // Calls body(first, size) for each array of one member in a flat buffer.
  template <typename Body>
  void ForEachRange(int member, Body body) const {
    for (const Layer& layer : layers_) {
      const int64_t weights = layer.weight_size / shape_.members;
      const int64_t biases = layer.bias_size / shape_.members;
      body(layer.weight + member * weights, weights);
      body(layer.bias + member * biases, biases);
    }
  }

  // Draws initial weights into `parameters`, layer by layer and member by member.
  template <typename Scalar>
  void Initialize(Initialization initialization, Rng& rng, std::span<Scalar> parameters) const;
  // Draws the output layer again: weight ~ U(-b, b), b = gain sqrt(6 / (inputs + outputs)), and
  // bias 0 (Glorot and Bengio 2010).
  template <typename Scalar>
  void InitializeHead(double gain, Rng& rng, std::span<Scalar> parameters) const;

  // Visits each layer's arrays in `parameters` as "<prefix>/layer<i>/weight" and ".../bias".
  template <typename Scalar>
  void Visit(std::string_view prefix, std::span<Scalar> parameters,
             const ArrayVisitor<Scalar>& visitor) const;

 private:
  MlpShape shape_;
  std::vector<Layer> layers_;
  int64_t size_ = 0;
};

template <typename Scalar>
struct MlpWorkspace {
  // A workspace for passes over `members` of the layout's members and up to `batch_max` columns, by
  // `threads` threads, of which at most `members` are used. `keep_gradients` false saves the memory
  // that only the backward pass needs.
  MlpWorkspace(const MlpLayout& layout, int members, int batch_max, int threads = 1,
               bool keep_gradients = true);

  int members;
  int batch = 0;  // columns of the last forward pass
  // Per hidden layer a matrix of width x (members * batch_max), with member m in the columns from
  // m * batch_max on; the last matrix is the stacked output.
  std::vector<MatrixBuffer<Scalar>> activations;
  std::vector<MatrixBuffer<Scalar>> slopes;  // swish's derivative per hidden layer; ReLU: empty
  std::vector<MatrixBuffer<Scalar>>
      gradients;  // d loss / d activation per hidden layer, then d loss / d output
  std::vector<MatrixBuffer<Scalar>> transposed;  // per thread: one layer's weights of one member
  std::shared_ptr<ThreadTeam> team;              // copies of a workspace share it
  // For MlpBackwardToInput: per member, the columns of the batch that have a gradient, and space
  // for d loss / d input of one member's columns.
  std::vector<std::vector<int>> kept;
  MatrixBuffer<Scalar> input_gradient;

  MatrixView<Scalar> output() { return activations.back().view(batch); }
  // d loss / d output, which the caller fills between MlpForward and MlpBackward.
  MatrixView<Scalar> output_gradient() { return gradients.back().view(batch); }
};

// Evaluates members [first_member, first_member + workspace.members). `input` has shape.inputs rows
// (shared by the members) or workspace.members * inputs rows (one block each), and at most
// batch_max columns. Returns workspace.output(): (members * outputs) x batch.
template <typename Scalar>
MatrixView<Scalar> MlpForward(const MlpLayout& layout, std::span<const Scalar> parameters,
                              MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                              int first_member = 0);

// Gradients of a loss from workspace.output_gradient(), for the members of the last MlpForward on
// this workspace, which must have had the same `input` and `first_member`. Overwrites these
// members' ranges of `parameter_gradient`, which has the layout's size.
template <typename Scalar>
void MlpBackward(const MlpLayout& layout, std::span<const Scalar> parameters,
                 MatrixView<const Scalar> input, MlpWorkspace<Scalar>& workspace,
                 std::span<Scalar> parameter_gradient, int first_member = 0);

// Writes d loss / d input instead of the parameters' gradients: for the rows [first_row, first_row
// + input_gradient.rows) of an input that the members share, summed over the members. A member's
// pass leaves out the columns in which the member's output gradient is 0, and moves the remaining
// columns to the front of the workspace's blocks; so after this call there is no other backward
// pass before the next MlpForward. In the loss -mean min(Q_1, Q_2) of an actor, this halves the
// work: each column's minimum belongs to one critic.
template <typename Scalar>
void MlpBackwardToInput(const MlpLayout& layout, std::span<const Scalar> parameters, int first_row,
                        MlpWorkspace<Scalar>& workspace, MatrixView<Scalar> input_gradient,
                        int first_member = 0);

}  // namespace b4mrl
