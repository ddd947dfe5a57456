// The recorded HalfCheetah trajectories; columns as in README.md.
#pragma once

#include <span>
#include <string>

#include "tests/reference/npy.h"

namespace b4mrl {

struct HalfCheetahRow {
  std::span<const double> action, qpos, qvel, warmstart;
  double reward;

  // The observation of this row's state.
  std::vector<double> observation() const {
    std::vector<double> observation(qpos.begin() + 1, qpos.end());
    observation.insert(observation.end(), qvel.begin(), qvel.end());
    return observation;
  }
};

class HalfCheetahReference {
 public:
  static constexpr size_t kTrajectories = 2;
  static constexpr size_t kSteps = 200;

  // `name`: "half_cheetah" or "half_cheetah_gravity2".
  explicit HalfCheetahReference(const std::string& name)
      : array_(ReadNpy(std::string(B4MRL_SOURCE_DIR) + "/tests/reference/" + name + ".npy")) {
    REQUIRE(array_.shape == std::vector<size_t>{kTrajectories, kSteps + 1, 34});
  }

  // A view into this object.
  HalfCheetahRow Row(size_t trajectory, size_t row) const&& = delete;
  HalfCheetahRow Row(size_t trajectory, size_t row) const& {
    const std::span<const double> values = array_.Row(trajectory, row);
    return {values.subspan(0, 6), values.subspan(6, 9), values.subspan(15, 9),
            values.subspan(24, 9), values[33]};
  }

 private:
  NpyArray array_;
};

}  // namespace b4mrl
