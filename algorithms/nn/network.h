// A network in training as one bundle: its weights with all that a gradient step needs.
//
//   network.Forward(input); fill network.workspace.output_gradient();
//   network.Backward(input); network.Step();
//
// is one step of gradient descent. A core (algorithms/cores) owns a bundle for each network of its
// algorithm, and its checkpoint holds what Visit and VisitCounters show. All memory is taken at
// construction: passes and steps allocate nothing. Thread rule: one thread; threads of the
// workspace share out the members.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/nn/adam.h"
#include "algorithms/nn/mlp.h"
#include "algorithms/nn/parameters.h"
#include "proto/base/rng.h"

namespace b4mrl {

// Numbers that Adam trains, with their gradient and Adam's moments.
template <typename Scalar>
struct TrainedVector {
  TrainedVector(int64_t size, double learning_rate, const std::vector<DecayRange>& decay = {})
      : values(size), gradient(size), adam({.learning_rate = learning_rate}, size, decay) {}

  // One step of Adam along `gradient`.
  void Step() { adam.Step(values, gradient); }

  // The values under `name`, Adam's moments under "<name>/adam/..."; nothing where there are none.
  void Visit(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
    if (values.empty()) return;
    visitor({name, {static_cast<int>(values.size())}, values});
    adam.Visit(name + "/adam", visitor);
  }
  void VisitCounters(const std::string& name, const CounterVisitor& visitor) {
    adam.VisitCounters(name + "/adam", visitor);
  }
  void VisitGradient(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
    if (!values.empty()) visitor({name, {static_cast<int>(values.size())}, gradient});
  }

  AlignedVector<Scalar> values, gradient;
  Adam<Scalar> adam;
};

// How a network's weights begin.
struct InitialWeights {
  Rng stream;  // from which they are drawn
  Initialization initialization = Initialization::kTorchUniform;
  std::optional<double> head_gain;  // draw the output layer again: MlpLayout::InitializeHead
};

struct NetworkOptions {
  MlpShape shape;
  double learning_rate = 3e-4;  // Adam's
  int batch_max = 256;          // most columns of a pass
  int threads = 1;              // of a pass; at most shape.members are of use
  bool has_target = false;      // whether a slow copy of the weights is kept
  int scalars = 0;              // numbers behind the layers that the same Adam trains, 0 at first
  InitialWeights weights;
};

template <typename Scalar>
struct Network : TrainedVector<Scalar> {
  using TrainedVector<Scalar>::adam, TrainedVector<Scalar>::gradient, TrainedVector<Scalar>::values;

  explicit Network(const NetworkOptions& options);

  // Outputs of all members, (members * outputs) x n, for an input of n <= batch_max columns.
  MatrixView<Scalar> Forward(MatrixView<const Scalar> input) {
    return MlpForward<Scalar>(layout, values, input, workspace);
  }
  MatrixView<Scalar> ForwardTarget(MatrixView<const Scalar> input) {
    return MlpForward<Scalar>(layout, target, input, workspace);
  }
  // Writes `gradient` from workspace.output_gradient(), after Forward on the same input.
  void Backward(MatrixView<const Scalar> input) {
    MlpBackward<Scalar>(layout, values, input, workspace, gradient);
  }
  // Instead of Backward, where the weights are not trained: writes d loss / d input of the input's
  // rows [first_row, first_row + input_gradient.rows), summed over the members.
  void BackwardToInput(MatrixView<const Scalar> input, int first_row,
                       MatrixView<Scalar> input_gradient) {
    MlpBackward<Scalar>(layout, values, input, workspace, {});
    MlpInputGradient<Scalar>(layout, values, first_row, workspace, input_gradient);
  }
  // One step of Adam, then target <- tau * weights + (1 - tau) * target, in one pass.
  void StepWithTarget(double tau) { adam.StepWithPolyak(values, gradient, tau, target); }

  // Layers under "<name>/...", the target's under "<name>_target/...", Adam's moments under
  // "<name>/adam/...". The scalars behind the layers are left to the owner.
  void Visit(const std::string& name, const ArrayVisitor<Scalar>& visitor);
  void VisitGradient(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
    layout.Visit<Scalar>(name, gradient, visitor);
  }

  MlpLayout layout;              // of `values`, `gradient` and `target`
  AlignedVector<Scalar> target;  // empty without one
  MlpWorkspace<Scalar> workspace;
};

template <typename Scalar>
Network<Scalar>::Network(const NetworkOptions& options)
    : TrainedVector<Scalar>(MlpLayout(options.shape).size() + options.scalars,
                            options.learning_rate),
      layout(options.shape),
      workspace(layout, options.shape.members, options.batch_max, options.threads) {
  const InitialWeights& weights = options.weights;
  Rng rng = weights.stream;
  layout.Initialize<Scalar>(weights.initialization, rng, values);
  if (weights.head_gain) layout.InitializeHead<Scalar>(*weights.head_gain, rng, values);
  if (options.has_target) target = values;
}

template <typename Scalar>
void Network<Scalar>::Visit(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
  layout.Visit<Scalar>(name, values, visitor);
  if (!target.empty()) layout.Visit<Scalar>(name + "_target", target, visitor);
  adam.Visit(name + "/adam", visitor);
}

}  // namespace b4mrl
