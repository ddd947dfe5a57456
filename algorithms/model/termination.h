// When a predicted observation ends an episode: when a number of it is outside the bounds that the
// daemon's catalogue has for the environment (EnvironmentSpec::termination), compared in float32.
//
// The bounds apply to observations as the policy sees them: a dimension that the dataset hides is
// always zero and says nothing about health, so its bounds are left out. Value type; no thread
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
  // `mask`: by dimension of the observation, 1 seen and 0 hidden; empty: all seen. kUnsupported for
  // an environment whose observations do not tell that an episode ends; kInternal for bounds on a
  // dimension that the environment does not have.
  static Result<Termination> Of(const EnvironmentSpec& environment,
                                std::span<const float> mask = {});

  // `next_observation` has all dimensions of the environment's observation.
  bool Ends(std::span<const float> next_observation) const;

 private:
  // DimensionBounds in float32.
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
