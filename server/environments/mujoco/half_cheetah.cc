// HalfCheetah: nine coordinates in the x-z plane (rootx, rootz, rooty and six joints), six torque
// motors, 20 steps a second.
//   observation  planar_runner.h, not clipped
//   reward       locomotion.h; it cannot fall: no survival, no termination
//   reset        qpos0 + U(-s, s), qvel = s N(0, 1); s = reset_noise_scale
// Versions 4 and 5 simulate alike and differ in their infos.
#include "server/environments/mujoco/planar_runner.h"

namespace b4mrl {
namespace {

class HalfCheetah final : public PlanarRunner {
 public:
  static constexpr const char* kModelFile = "half_cheetah.xml";
  static constexpr ModelShape kShape = {
      .positions = 9, .velocities = 9, .motors = 6, .timestep = 0.01};

  HalfCheetah(const EnvironmentSpec& spec, const LocomotionSettings& settings,
              MujocoScratch scratch)
      : PlanarRunner(spec, settings, InfoColumns(settings), std::move(scratch),
                     std::numeric_limits<double>::infinity()) {}

  static LocomotionSettings ReadSettings(ConfigReader& reader) {
    LocomotionSettings settings;
    settings.forward_reward_weight = 1;
    settings.ctrl_cost_weight = 0.1;
    settings.reset_noise_scale = 0.1;
    settings.frame_skip = 5;
    ReadCommonSettings(reader, &settings);
    return settings;
  }

  static EnvironmentSpec Describe(const LocomotionSettings& settings) {
    static constexpr const char* kJoints[] = {"bthigh", "bshin", "bfoot",
                                              "fthigh", "fshin", "ffoot"};
    EnvironmentSpec spec = DescribePlanarRunner("HalfCheetah", kJoints, settings);
    DescribeLocomotion(settings, InfoColumns(settings), &spec);
    spec.reward =
        "forward_reward_weight * (x_after - x_before) / dt - ctrl_cost_weight * sum(action^2)";
    spec.step_seconds = kShape.timestep * settings.frame_skip;
    spec.termination.emplace();        // no rules: never terminates
    spec.reference_min = -280.178953;  // D4RL's reference scores
    spec.reference_max = 12135.0;
    return spec;
  }

  static std::span<const InfoColumn> InfoColumns(const LocomotionSettings& settings) {
    static constexpr InfoColumn kV4[] = {{"x_position", Info::kX},
                                         {"x_velocity", Info::kXVelocity},
                                         {"reward_run", Info::kForward},
                                         {"reward_ctrl", Info::kControl}};
    static constexpr InfoColumn kV5[] = {{"x_position", Info::kX, true},
                                         {"x_velocity", Info::kXVelocity},
                                         {"reward_forward", Info::kForward},
                                         {"reward_ctrl", Info::kControl}};
    return settings.v5 ? std::span<const InfoColumn>(kV5) : std::span<const InfoColumn>(kV4);
  }

 protected:
  void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const override {
    const double scale = settings().reset_noise_scale;
    for (double& x : qpos) x += rng.Uniform(-scale, scale);
    for (double& v : qvel) v = scale * rng.Normal();
  }
};

using Model = MujocoTask<HalfCheetah>;

}  // namespace

extern const EnvironmentEntry kHalfCheetah;  // its line in list.cc
constinit const EnvironmentEntry kHalfCheetah = {"HalfCheetah", Model::Complete, Model::Describe,
                                                 Model::Open};

}  // namespace b4mrl
