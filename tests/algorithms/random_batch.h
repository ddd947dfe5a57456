// A batch of random transitions that owns its numbers.
#pragma once

#include <vector>

#include "algorithms/cores/transition_batch.h"
#include "proto/base/rng.h"

namespace b4mrl {

template <typename Scalar>
struct RandomBatch {
  RandomBatch(int observation_size, int action_size, int size, uint64_t seed)
      : observations(observation_size, size),
        actions(action_size, size),
        next_observations(observation_size, size),
        rewards(size),
        not_terminated(size) {
    Rng rng(seed, "random-batch");
    rng.FillNormal(observations.values());
    rng.FillNormal(next_observations.values());
    rng.FillNormal(std::span<Scalar>(rewards));
    for (Scalar& action : actions.values()) action = static_cast<Scalar>(rng.Uniform(-1, 1));
    for (Scalar& flag : not_terminated) flag = rng.Below(5) == 0 ? Scalar(0) : Scalar(1);
  }

  TransitionBatch<Scalar> Views() const {
    return {observations.view(), actions.view(), rewards, next_observations.view(), not_terminated};
  }

  MatrixBuffer<Scalar> observations, actions, next_observations;
  std::vector<Scalar> rewards, not_terminated;
};

}  // namespace b4mrl
