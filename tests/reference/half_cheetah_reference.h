// The recorded HalfCheetah trajectories, as recordings of MujocoReference.
#pragma once

#include <string>
#include <vector>

#include "tests/reference/mujoco_reference.h"

namespace b4mrl {

struct HalfCheetahRow : MujocoRow {
  std::vector<double> observation() const {
    return {MujocoRow::observation.begin(), MujocoRow::observation.end()};
  }
};

class HalfCheetahReference {
 public:
  static constexpr size_t kTrajectories = 2;
  static constexpr size_t kSteps = 200;

  // `name`: "half_cheetah" or "half_cheetah_gravity2".
  explicit HalfCheetahReference(const std::string& name) : reference_(name, kHalfCheetahShape) {
    REQUIRE(reference_.trajectories() == kTrajectories);
    REQUIRE(reference_.steps() == kSteps);
  }

  // A view into this object.
  HalfCheetahRow Row(size_t trajectory, size_t row) const&& = delete;
  HalfCheetahRow Row(size_t trajectory, size_t row) const& {
    return {reference_.Row(trajectory, row)};
  }

 private:
  MujocoReference reference_;
};

}  // namespace b4mrl
