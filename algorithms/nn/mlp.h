// Multi-layer perceptrons: one network, or several networks of equal shape as members of one
// object. An actor has one member, twin critics have two, a dynamics ensemble has seven.
//
// MlpLayout (mlp_layout.h) says where each layer's numbers lie in one flat parameter buffer.
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

#include <memory>
#include <span>
#include <vector>

#include "algorithms/nn/mlp_layout.h"
#include "algorithms/nn/products/left_factor.h"
#include "algorithms/nn/products/view.h"
#include "algorithms/nn/thread_team.h"

namespace b4mrl {

struct MlpWorkspaceOptions {
  int members = 1;             // members of the layout that a pass evaluates
  int batch_max = 256;         // most columns of a pass
  int threads = 1;             // threads of a pass; at most `members` are used
  bool keep_gradients = true;  // false saves the memory that only the backward pass needs
  Precision precision = Precision::kFp32;  // of products between two hidden layers
};

template <typename Scalar>
struct MlpWorkspace {
  MlpWorkspace(const MlpLayout& layout, const MlpWorkspaceOptions& options);

  int members;
  Precision precision;
  int batch = 0;  // columns of the last forward pass
  // Per hidden layer a matrix of width x (members * batch_max), with member m in the columns from
  // m * batch_max on; the last matrix is the stacked output.
  std::vector<MatrixBuffer<Scalar>> activations;
  std::vector<MatrixBuffer<Scalar>> slopes;  // swish's derivative per hidden layer; ReLU: empty
  std::vector<MatrixBuffer<Scalar>>
      gradients;  // d loss / d activation per hidden layer, then d loss / d output
  std::shared_ptr<ThreadTeam> team;             // copies of a workspace share it
  std::vector<ProductScratch<Scalar>> scratch;  // per thread
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
