// When a predicted observation ends an episode: the termination functions of MOPO (mopo/static, as
// junming-yang/mopo runs them), in float as there.
//
//   HalfCheetah  never
//   Hopper       unless all numbers are finite, o[1], o[2], ... < 100, height o[0] > 0.7 and
//                |pitch o[1]| < 0.2. The true environment also wants o[i] > -100; the source takes
//                the absolute value of the comparison instead of the number, and so asks for the
//                upper bound alone. That is what the paper's results were made with.
//   Walker2d     unless 0.8 < height o[0] < 2 and |pitch o[1]| < 1
//   Humanoid     unless 1 <= height o[0] <= 2
//
// They see what the policy sees: a dimension that the dataset hides is always zero and says nothing
// about health, so bounds on it are left out. Value type; no thread rule.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Termination {
 public:
  // `mask`: of an observation, 1 seen and 0 hidden; empty: all seen. kUnsupported for an
  // environment whose end cannot be told from an observation.
  static Result<Termination> Of(const EnvironmentSpec& environment,
                                std::span<const float> mask = {});

  bool Ends(std::span<const float> next_observation) const;

 private:
  // What a dimension of a healthy observation lies in.
  struct Bound {
    size_t dimension;
    float low;
    float high;
    bool closed = false;  // the limits themselves are healthy
  };
  explicit Termination(std::vector<Bound> bounds) : bounds_(std::move(bounds)) {}

  std::vector<Bound> bounds_;
};

}  // namespace b4mrl
