// Whether a predicted observation ends an episode: it does if one of its numbers is outside the
// bounds that the daemon's catalogue gives for the environment (EnvironmentSpec::termination),
// compared in float32.
//
// The bounds apply to observations as the policy sees them: a dimension that the dataset hides is
// always zero and says nothing about the state, so its bounds are left out. Value type; no thread
// rule.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Termination {
 public:
  // `mask`: for each dimension of an observation 1 if it is seen, 0 if hidden; empty: all are seen.
  // kUnsupported for an environment whose observations do not tell that an episode ends; kInternal
  // for bounds on a dimension that the environment does not have.
  static Result<Termination> Of(const EnvironmentSpec& environment,
                                std::span<const float> mask = {});

  // `next_observation` has all dimensions of the environment's observation.
  bool Ends(std::span<const float> next_observation) const;

 private:
  // A DimensionBounds with low and high rounded to float32.
  struct Bound {
    size_t dimension;
    float low;
    float high;
    bool inclusive;
  };
  explicit Termination(std::vector<Bound> bounds) : bounds_(std::move(bounds)) {}

  std::vector<Bound> bounds_;
};

}  // namespace b4mrl
