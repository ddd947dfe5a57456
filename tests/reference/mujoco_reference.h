// The recorded trajectories of the MuJoCo tasks; columns as in README.md.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>

#include "tests/reference/npy.h"

namespace b4mrl {

struct MujocoRow {
  std::span<const double> action, qpos, qvel, warmstart, observation;
  double reward;  // version 4's
  double reward_v5;
  bool terminated;
};

// Of a task: the columns of its recordings, and how its observation tells the state.
struct MujocoShape {
  size_t motors, positions, velocities, observation;
  size_t hidden_positions = 1;  // leading coordinates that are not observed
  // Observed velocities are clipped to this; where one is, the observation does not tell the state.
  double velocity_limit = std::numeric_limits<double>::infinity();
  // A query starts from a warm start of 0, not from the recorded one. Newton converges: 1e-14 in
  // position.
  double query_tolerance = 1e-12;
  double query_reward_tolerance = 1e-9;
};
inline constexpr MujocoShape kHalfCheetahShape = {6, 9, 9, 17};
inline constexpr MujocoShape kHopperShape = {3, 6, 6, 11, 1, 10};
inline constexpr MujocoShape kWalker2dShape = {6, 9, 9, 17, 1, 10};
inline constexpr MujocoShape kHumanoidShape = {
    .motors = 17,
    .positions = 24,
    .velocities = 23,
    .observation = 376,
    .hidden_positions = 2,
    .query_tolerance = 1e-5,  // PGS stops after 50 iterations: up to 9e-6
    // The recorded reward starts from a centre of mass that lags behind by up to 5e-5 m; times
    // 1.25 / 0.015 s.
    .query_reward_tolerance = 5e-3,
};

// A recording and the simulator that it was made of.
struct MujocoRecording {
  const char* file;
  const char* environment;
  const char* perturbations;
  const char* config;
  bool v5_reward;
  MujocoShape shape;
};
// Walker2d's version 5 has a model of its own, the others only another reward.
inline constexpr MujocoRecording kMujocoRecordings[] = {
    {"half_cheetah", "HalfCheetah", "", "", false, kHalfCheetahShape},
    {"half_cheetah_gravity2", "HalfCheetah", "gravity", "", false, kHalfCheetahShape},
    {"hopper", "Hopper", "", "", false, kHopperShape},
    {"hopper", "Hopper", "", R"({"version": "v5"})", true, kHopperShape},
    {"hopper_gravity2", "Hopper", "gravity", "", false, kHopperShape},
    {"walker2d", "Walker2d", "", "", false, kWalker2dShape},
    {"walker2d_friction03", "Walker2d", "friction", "", false, kWalker2dShape},
    {"walker2d_v5", "Walker2d", "", R"({"version": "v5"})", true, kWalker2dShape},
    {"humanoid", "Humanoid", "", "", false, kHumanoidShape},
    {"humanoid_gravity2", "Humanoid", "gravity=2", "", false, kHumanoidShape},
};

class MujocoReference {
 public:
  explicit MujocoReference(const MujocoRecording& recording)
      : MujocoReference(recording.file, recording.shape) {}
  // `name`: of a file, "hopper".
  MujocoReference(const std::string& name, const MujocoShape& shape)
      : array_(ReadNpy(B4MRL_SOURCE_DIR "/tests/reference/" + name + ".npy")),
        shape_(shape) {
    REQUIRE(array_.shape.size() == 3);
    REQUIRE(array_.shape[2] ==
            shape.motors + shape.positions + 2 * shape.velocities + shape.observation + 3);
  }

  size_t trajectories() const { return array_.shape[0]; }
  size_t steps() const { return array_.shape[1] - 1; }

  // Row 0 is the start as it is set, row k follows step k. A view into this object.
  MujocoRow Row(size_t trajectory, size_t row) const&& = delete;
  MujocoRow Row(size_t trajectory, size_t row) const& {
    std::span<const double> values = array_.Row(trajectory, row);
    const auto take = [&values](size_t count) {
      const std::span<const double> taken = values.first(count);
      values = values.subspan(count);
      return taken;
    };
    MujocoRow result{.action = take(shape_.motors),
                     .qpos = take(shape_.positions),
                     .qvel = take(shape_.velocities),
                     .warmstart = take(shape_.velocities),
                     .observation = take(shape_.observation),
                     .reward = values[0],
                     .reward_v5 = values[1],
                     .terminated = values[2] != 0};
    return result;
  }

 private:
  NpyArray array_;
  MujocoShape shape_;
};

}  // namespace b4mrl
