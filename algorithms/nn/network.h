// A network in training: its weights, and the gradients, workspace and optimiser of a gradient
// step.
//
//   network.Forward(input); fill network.workspace.output_gradient();
//   network.Backward(input); network.Step();
//
// is one step of gradient descent. A core (algorithms/cores) owns a Network for each network of its
// algorithm and lists them once, in ForEachPart; from this list, TrainedParts makes the visitors
// for checkpoints and tests. All memory is allocated at construction, none by passes and steps.
// Thread rule: one thread; the workspace's threads share out the members.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <type_traits>
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
      : values(size), gradient(size), adam(learning_rate, size, decay) {}

  // One step of Adam along `gradient`.
  void Step() { adam.Step(values, gradient); }

  // Visits the values as `name` and Adam's moments as "<name>/adam/...", unless there are no
  // values.
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

// How the initial weights of a network are drawn.
struct InitialWeights {
  Rng stream;  // random numbers of the draw
  Initialization initialization = Initialization::kTorchUniform;
  std::optional<double> head_gain;  // if given, MlpLayout::InitializeHead draws the output layer
};

struct NetworkOptions {
  MlpShape shape;
  double learning_rate = 3e-4;             // Adam's
  int batch_max = 256;                     // most columns of a pass
  int threads = 1;                         // threads of a pass; at most shape.members are used
  Precision precision = Precision::kFp32;  // of products between two hidden layers
  bool has_target = false;                 // whether to keep a target network
  int scalars = 0;                         // extra numbers that the same Adam trains, 0 at first
  std::string scalars_name;  // Visit shows the scalars as "<network's name>/<scalars_name>"
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
  // Writes d loss / d input instead of `gradient`, after Forward: see MlpBackwardToInput.
  void BackwardToInput(int first_row, MatrixView<Scalar> input_gradient) {
    MlpBackwardToInput<Scalar>(layout, values, first_row, workspace, input_gradient);
  }
  // One step of Adam, then target <- tau * weights + (1 - tau) * target, in one pass.
  void StepWithTarget(double tau) { adam.StepWithPolyak(values, gradient, tau, target); }

  // The NetworkOptions::scalars extra numbers, stored behind the layers, and their gradient.
  std::span<Scalar> scalars() { return BehindLayers<Scalar>(values); }
  std::span<const Scalar> scalars() const { return BehindLayers<const Scalar>(values); }
  std::span<Scalar> scalar_gradient() { return BehindLayers<Scalar>(gradient); }

  // Visits the layers as "<name>/...", the target's layers as "<name>_target/...", and Adam's
  // moments as "<name>/adam/...".
  void Visit(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
    VisitWeights(name, values, visitor);
    if (!target.empty()) layout.Visit<Scalar>(name + "_target", target, visitor);
    adam.Visit(name + "/adam", visitor);
  }
  void VisitGradient(const std::string& name, const ArrayVisitor<Scalar>& visitor) {
    VisitWeights(name, gradient, visitor);
  }

  MlpLayout layout;              // of `values`, `gradient` and `target`
  AlignedVector<Scalar> target;  // the target network's weights; empty without a target network
  MlpWorkspace<Scalar> workspace;

 private:
  template <typename Number>
  std::span<Number> BehindLayers(std::span<Number> numbers) const {
    return numbers.subspan(layout.size());
  }
  void VisitWeights(const std::string& name, std::span<Scalar> numbers,
                    const ArrayVisitor<Scalar>& visitor) {
    layout.Visit<Scalar>(name, numbers, visitor);
    const std::span<Scalar> behind = BehindLayers(numbers);
    if (behind.empty()) return;
    visitor({name + "/" + scalars_name_, {static_cast<int>(behind.size())}, behind});
  }

  std::string scalars_name_;
};

template <typename Scalar>
Network<Scalar>::Network(const NetworkOptions& options)
    : TrainedVector<Scalar>(MlpLayout(options.shape).size() + options.scalars,
                            options.learning_rate),
      layout(options.shape),
      workspace(layout, {.members = options.shape.members,
                         .batch_max = options.batch_max,
                         .threads = options.threads,
                         .precision = options.precision}),
      scalars_name_(options.scalars_name) {
  const InitialWeights& weights = options.weights;
  Rng rng = weights.stream;
  layout.Initialize<Scalar>(weights.initialization, rng, values);
  if (weights.head_gain) layout.InitializeHead<Scalar>(*weights.head_gain, rng, values);
  if (options.has_target) target = values;
}

// Makes the visitors of a core's state from one list of the core's parts. A core derives from this
// class and has a public
//
//   template <typename Body>
//   void ForEachPart(Body body) { body("updates", updates_); body("critic", critics_); ... }
//
// A part is a Network, a TrainedVector or a counter (int64_t). A core within a core adds its parts
// to the list by its own ForEachPart.
template <typename Core, typename Scalar>
class TrainedParts {
 public:
  // All state, for checkpoints and tests: see nn/parameters.h.
  void VisitArrays(const ArrayVisitor<Scalar>& visitor) {
    core().ForEachPart([&]<typename Part>(const std::string& name, Part& part) {
      if constexpr (!kIsCounter<Part>) part.Visit(name, visitor);
    });
  }
  void VisitCounters(const CounterVisitor& visitor) {
    core().ForEachPart([&]<typename Part>(const std::string& name, Part& part) {
      if constexpr (kIsCounter<Part>) {
        visitor({name, &part});
      } else {
        part.VisitCounters(name, visitor);
      }
    });
  }
  // Gradients of the last update, under the names of the parameters; for tests.
  void VisitGradients(const ArrayVisitor<Scalar>& visitor) {
    core().ForEachPart([&]<typename Part>(const std::string& name, Part& part) {
      if constexpr (!kIsCounter<Part>) part.VisitGradient(name, visitor);
    });
  }

 private:
  template <typename Part>
  static constexpr bool kIsCounter = std::is_same_v<Part, int64_t>;

  Core& core() { return static_cast<Core&>(*this); }
};

}  // namespace b4mrl
