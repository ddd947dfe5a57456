// Adam (Kingma and Ba 2015, algorithm 1, as torch.optim.Adam computes it) over one flat buffer, and
// Polyak averaging, which the same pass over memory can do.
//
//   m = b1 m + (1 - b1) g;  v = b2 v + (1 - b2) g^2
//   p -= lr / (1 - b1^t) * m / (sqrt(v) / sqrt(1 - b2^t) + eps)
//   target = (1 - tau) target + tau p
//
// with b1 = 0.9, b2 = 0.999 and eps = 1e-8, as the paper proposes and PyTorch has them.
// Ranges of the buffer may have an L2 penalty: there, g is the gradient plus coefficient * p, added
// in the same pass (part of the loss, not decoupled weight decay). Thread rule: one thread, except
// for StepPart.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/parameters.h"
#include "algorithms/nn/products/view.h"

namespace b4mrl {

// g += coefficient * p for p in [first, first + size): the gradient of coefficient / 2 * sum p^2.
struct DecayRange {
  int64_t first;
  int64_t size;
  double coefficient;
};

// The constants of one step, computed from the step's number.
template <typename Scalar>
struct AdamStep {
  Scalar beta1, beta2, step_size, root_scale, epsilon;
};

template <typename Scalar>
class Adam {
 public:
  Adam() = default;
  // `decay`: ascending ranges that do not overlap.
  Adam(double learning_rate, int64_t size, const std::vector<DecayRange>& decay = {});

  // One Adam step; the spans have the size given at construction.
  void Step(std::span<Scalar> parameters, std::span<const Scalar> gradient);
  // One Adam step, then target <- tau * parameters + (1 - tau) * target in the same pass.
  void StepWithPolyak(std::span<Scalar> parameters, std::span<const Scalar> gradient, double tau,
                      std::span<Scalar> target);

  // A step in parts, so that each part's gradient is still in the cache: BeginStep once, then
  // StepPart for ranges [first, first + size) of the spans that together cover every number once,
  // in any order. Several threads may call StepPart at once for ranges that do not overlap.
  void BeginStep();
  void StepPart(std::span<Scalar> parameters, std::span<const Scalar> gradient, int64_t first,
                int64_t size);

  void set_learning_rate(double learning_rate) { learning_rate_ = learning_rate; }
  int64_t steps() const { return steps_; }

  // Visit shows the arrays "<prefix>/first_moment" and "<prefix>/second_moment", VisitCounters the
  // counter "<prefix>/steps".
  void Visit(std::string_view prefix, const ArrayVisitor<Scalar>& visitor);
  void VisitCounters(std::string_view prefix, const CounterVisitor& visitor);

 private:
  double learning_rate_ = 0;
  std::vector<DecayRange> ranges_;  // cover the whole buffer, with coefficient 0 in the gaps
  int64_t steps_ = 0;
  AdamStep<Scalar> step_{};  // written by BeginStep
  AlignedVector<Scalar> first_moment_;
  AlignedVector<Scalar> second_moment_;
};

}  // namespace b4mrl
