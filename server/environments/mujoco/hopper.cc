// Hopper: one leg in the x-z plane, six coordinates (rootx, rootz, rooty and three joints), three
// torque motors, 125 steps a second.
//   observation  planar_runner.h, velocities clipped to +-10
//   healthy      height in healthy_z_range, pitch in healthy_angle_range, and every other number of
//                the state, unclipped, in healthy_state_range
//   reward       locomotion.h
//   reset        qpos0 + U(-s, s), qvel = U(-s, s); s = reset_noise_scale
// qpos[1] is the torso's height above the floor: 1.25 m at the start.
#include <algorithm>

#include "server/environments/mujoco/planar_runner.h"

namespace b4mrl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Hopper final : public PlanarRunner {
 public:
  static constexpr const char* kModelFile = "hopper.xml";
  static constexpr ModelShape kShape = {
      .positions = 6, .velocities = 6, .motors = 3, .timestep = 0.002};
  static constexpr double kVelocityLimit = 10;
  static constexpr Interval kHealthyState = {-100, 100};

  Hopper(const EnvironmentSpec& spec, const LocomotionSettings& settings, MujocoScratch scratch)
      : PlanarRunner(spec, settings, PlanarWalkerInfos(settings), std::move(scratch),
                     kVelocityLimit) {}

  static LocomotionSettings ReadSettings(ConfigReader& reader) {
    LocomotionSettings settings = ReadPlanarWalkerSettings(reader, {0.7, kInfinity}, {-0.2, 0.2});
    settings.healthy_state = reader.Range("healthy_state_range", kHealthyState);
    return settings;
  }

  static EnvironmentSpec Describe(const LocomotionSettings& settings) {
    static constexpr const char* kJoints[] = {"thigh", "leg", "foot"};
    EnvironmentSpec spec = DescribePlanarRunner("Hopper", kJoints, settings);
    DescribePlanarWalker(settings, &spec);
    spec.step_seconds = kShape.timestep * settings.frame_skip;
    spec.reference_min = -20.272305;  // D4RL's reference scores
    spec.reference_max = 3234.3;
    if (!settings.terminate_when_unhealthy) return spec;
    // MOPO's source takes the absolute value of a comparison instead of the number's, and so tests
    // the upper bound of the default healthy_state_range alone, and not the pitch. MOPO's published
    // results were made with this rule. It knows no other range: for one the task's own rule holds.
    const auto [low, high] = settings.healthy_state;
    const bool is_mopos = low == kHealthyState.low && high == kHealthyState.high;
    const uint32_t pitch = HeightDimension(settings) + 1;
    for (uint32_t i = is_mopos ? pitch + 1 : pitch; i < spec.observation.size(); ++i) {
      spec.termination->push_back({i, is_mopos ? -kInfinity : low, high});
    }
    return spec;
  }

 protected:
  bool Healthy() const override {
    const auto in_range = [this](double x) { return settings().healthy_state.Contains(x); };
    return settings().healthy_z.Contains(height()) && settings().healthy_angle.Contains(pitch()) &&
           std::all_of(data().qpos + 2, data().qpos + kShape.positions, in_range) &&
           std::all_of(data().qvel, data().qvel + kShape.velocities, in_range);
  }
};

using Model = MujocoTask<Hopper>;

}  // namespace

extern const EnvironmentEntry kHopper;  // its line in list.cc
constinit const EnvironmentEntry kHopper = {"Hopper", Model::Complete, Model::Describe,
                                            Model::Open};

}  // namespace b4mrl
