#include "algorithms/nn/adam.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace b4mrl {
namespace {

constexpr double kBeta1 = 0.9;
constexpr double kBeta2 = 0.999;
constexpr double kEpsilon = 1e-8;

template <typename Scalar>
AdamStep<Scalar> MakeConstants(double learning_rate, int64_t step) {
  const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(step));
  const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(step));
  return {static_cast<Scalar>(kBeta1), static_cast<Scalar>(kBeta2),
          static_cast<Scalar>(learning_rate / correction1),
          static_cast<Scalar>(1 / std::sqrt(correction2)), static_cast<Scalar>(kEpsilon)};
}

// Updates both moments of one parameter and returns the parameter's new value.
template <typename Scalar>
inline Scalar StepOne(const AdamStep<Scalar>& c, Scalar parameter, Scalar gradient, Scalar& first,
                      Scalar& second) {
  first = c.beta1 * first + (1 - c.beta1) * gradient;
  second = c.beta2 * second + (1 - c.beta2) * (gradient * gradient);
  return parameter - c.step_size * first / (std::sqrt(second) * c.root_scale + c.epsilon);
}

template <typename Scalar>
void StepRange(const AdamStep<Scalar>& constants, Scalar decay, int64_t size, Scalar* __restrict p,
               const Scalar* __restrict g, Scalar* __restrict m, Scalar* __restrict v) {
  for (int64_t i = 0; i < size; ++i) {
    p[i] = StepOne(constants, p[i], g[i] + decay * p[i], m[i], v[i]);
  }
}

}  // namespace

template <typename Scalar>
Adam<Scalar>::Adam(double learning_rate, int64_t size, const std::vector<DecayRange>& decay)
    : learning_rate_(learning_rate), first_moment_(size), second_moment_(size) {
  int64_t end = 0;
  for (const DecayRange& range : decay) {
    if (range.first > end) ranges_.push_back({end, range.first - end, 0});
    ranges_.push_back(range);
    end = range.first + range.size;
  }
  if (end < size) ranges_.push_back({end, size - end, 0});
}

template <typename Scalar>
void Adam<Scalar>::Step(std::span<Scalar> parameters, std::span<const Scalar> gradient) {
  BeginStep();
  StepPart(parameters, gradient, 0, static_cast<int64_t>(parameters.size()));
}

template <typename Scalar>
void Adam<Scalar>::BeginStep() {
  step_ = MakeConstants<Scalar>(learning_rate_, ++steps_);
}

template <typename Scalar>
void Adam<Scalar>::StepPart(std::span<Scalar> parameters, std::span<const Scalar> gradient,
                            int64_t first, int64_t size) {
  for (const DecayRange& range : ranges_) {
    const int64_t begin = std::max(first, range.first);
    const int64_t end = std::min(first + size, range.first + range.size);
    if (begin >= end) continue;
    StepRange(step_, static_cast<Scalar>(range.coefficient), end - begin, parameters.data() + begin,
              gradient.data() + begin, first_moment_.data() + begin, second_moment_.data() + begin);
  }
}

template <typename Scalar>
void Adam<Scalar>::StepWithPolyak(std::span<Scalar> parameters, std::span<const Scalar> gradient,
                                  double tau, std::span<Scalar> target) {
  const AdamStep<Scalar> constants = MakeConstants<Scalar>(learning_rate_, ++steps_);
  const Scalar rate = static_cast<Scalar>(tau);
  for (const DecayRange& range : ranges_) {
    const Scalar decay = static_cast<Scalar>(range.coefficient);
    Scalar* __restrict p = parameters.data() + range.first;
    const Scalar* __restrict g = gradient.data() + range.first;
    Scalar* __restrict m = first_moment_.data() + range.first;
    Scalar* __restrict v = second_moment_.data() + range.first;
    Scalar* __restrict t = target.data() + range.first;
    for (int64_t i = 0; i < range.size; ++i) {
      p[i] = StepOne(constants, p[i], g[i] + decay * p[i], m[i], v[i]);
      t[i] = (1 - rate) * t[i] + rate * p[i];
    }
  }
}

template <typename Scalar>
void Adam<Scalar>::Visit(std::string_view prefix, const ArrayVisitor<Scalar>& visitor) {
  const int size = static_cast<int>(first_moment_.size());
  visitor({std::string(prefix) + "/first_moment", {size}, first_moment_});
  visitor({std::string(prefix) + "/second_moment", {size}, second_moment_});
}

template <typename Scalar>
void Adam<Scalar>::VisitCounters(std::string_view prefix, const CounterVisitor& visitor) {
  visitor({std::string(prefix) + "/steps", &steps_});
}

template class Adam<float>;
template class Adam<double>;

}  // namespace b4mrl
