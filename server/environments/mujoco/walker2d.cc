// Walker2d: two legs in the x-z plane, nine coordinates (rootx, rootz, rooty and three joints a
// leg), six torque motors, 125 steps a second.
//   observation  planar_runner.h, velocities clipped to +-10
//   healthy      height in healthy_z_range and pitch in healthy_angle_range
//   reward       locomotion.h
//   reset        qpos0 + U(-s, s), qvel = U(-s, s); s = reset_noise_scale
// In version 4 the right foot slides twice as easily as the left one (friction 0.9 and 1.9); in
// version 5 both have 1.9. qpos[1] is the torso's height above the floor: 1.25 m at the start.
#include "server/environments/mujoco/planar_runner.h"

namespace b4mrl {
namespace {

class Walker2d final : public PlanarRunner {
 public:
  static constexpr const char* kModelFile = "walker2d.xml";
  static constexpr ModelShape kShape = {
      .positions = 9, .velocities = 9, .motors = 6, .timestep = 0.002};
  static constexpr double kVelocityLimit = 10;

  Walker2d(const EnvironmentSpec& spec, const LocomotionSettings& settings, MujocoScratch scratch)
      : PlanarRunner(spec, settings, PlanarWalkerInfos(settings), std::move(scratch),
                     kVelocityLimit) {}

  static LocomotionSettings ReadSettings(ConfigReader& reader) {
    return ReadPlanarWalkerSettings(reader, {0.8, 2.0}, {-1, 1});
  }

  static EnvironmentSpec Describe(const LocomotionSettings& settings) {
    static constexpr const char* kJoints[] = {"thigh",      "leg",      "foot",
                                              "thigh-left", "leg-left", "foot-left"};
    EnvironmentSpec spec = DescribePlanarRunner("Walker2d", kJoints, settings);
    DescribePlanarWalker(settings, &spec);
    spec.step_seconds = kShape.timestep * settings.frame_skip;
    spec.reference_min = 1.629008;  // D4RL's reference scores
    spec.reference_max = 4592.3;
    return spec;
  }

  // MuJoCo reads friction from the compiled model at each step, so a change needs no compiling.
  static void AdaptModel(const LocomotionSettings& settings, mjModel* model) {
    const int foot = mj_name2id(model, mjOBJ_GEOM, "foot_geom");
    if (settings.v5 && foot >= 0) model->geom_friction[3 * foot] = 1.9;
  }

 protected:
  bool Healthy() const override {
    return settings().healthy_z.Contains(height()) && settings().healthy_angle.Contains(pitch());
  }
};

using Model = MujocoTask<Walker2d>;

}  // namespace

extern const EnvironmentEntry kWalker2d;  // its line in list.cc
constinit const EnvironmentEntry kWalker2d = {"Walker2d", Model::Complete, Model::Describe,
                                              Model::Open};

}  // namespace b4mrl
