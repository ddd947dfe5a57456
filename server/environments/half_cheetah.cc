// HalfCheetah: nine coordinates in the x-z plane (rootx, rootz, rooty and six joints), six torque
// motors.
//   observation  qpos[1..8], qvel[0..8], not clipped
//   reward       w_f (x_after - x_before) / dt - w_c sum(action^2), from the action as given,
//   although
//                the motors clip theirs to [-1, 1]
//   termination  never
//   reset        qpos0 + U(-s, s), qvel = s N(0, 1); s = reset_noise_scale
// Formulas and settings: Gymnasium's HalfCheetah-v4 and -v5, which simulate alike.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "server/environments/config_reader.h"
#include "server/environments/list.h"
#include "server/environments/mujoco_environment.h"

namespace b4mrl {
namespace {

constexpr const char* kModelFile = "half_cheetah.xml";
constexpr int kFrameSkip = 5;
constexpr double kStepSeconds = 0.05;
constexpr size_t kPositions = 9;  // also velocities
constexpr size_t kJoints = 6;

struct Settings {
  double forward_reward_weight;
  double ctrl_cost_weight;
  double reset_noise_scale;
};

class HalfCheetah final : public MujocoEnvironment {
 public:
  HalfCheetah(const EnvironmentSpec& spec, const Settings& settings, const mjModel& model,
              MjDataPtr data)
      : MujocoEnvironment(model, std::move(data), kFrameSkip), spec_(spec), settings_(settings) {}

  const EnvironmentSpec& spec() const override { return spec_; }

  void Observe(std::span<double> observation) const override {
    double* out = std::copy_n(data().qpos + 1, kPositions - 1, observation.data());
    std::copy_n(data().qvel, kPositions, out);
  }

 protected:
  void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const override {
    const double scale = settings_.reset_noise_scale;
    for (double& x : qpos) x += rng.Uniform(-scale, scale);
    for (double& v : qvel) v = scale * rng.Normal();
  }

  void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                            std::span<double> qvel) const override {
    std::copy_n(observation.data(), kPositions - 1, qpos.data() + 1);
    std::copy_n(observation.data() + kPositions - 1, kPositions, qvel.data());
  }

  double Progress() const override { return data().qpos[0]; }

  StepResult Judge(double x_before, std::span<const double> action) const override {
    double squares = 0;
    for (const double a : action) squares += a * a;
    const double velocity = (data().qpos[0] - x_before) / kStepSeconds;
    return {.reward =
                settings_.forward_reward_weight * velocity - settings_.ctrl_cost_weight * squares};
  }

 private:
  const EnvironmentSpec& spec_;
  const Settings& settings_;
};

Result<Config> Complete(const Config& config) {
  ConfigReader reader(config);
  reader.Choice("version", {"v4", "v5"});
  reader.Number("forward_reward_weight", 1.0, -1e6, 1e6);
  reader.Number("ctrl_cost_weight", 0.1, -1e6, 1e6);
  reader.Number("reset_noise_scale", 0.1, 0, 10);
  reader.Integer("max_episode_steps", 1000, 1, std::numeric_limits<uint32_t>::max());
  if (!reader.Bool("exclude_current_positions_from_observation", true)) {
    return Status(
        StatusCode::kUnsupported,
        "exclude_current_positions_from_observation is false, allowed: true: datasets and "
        "queries describe states by the 17 numbers without the root's x");
  }
  B4MRL_RETURN_IF_ERROR(reader.Finish());
  return reader.completed();
}

SpaceSpec ObservationSpace() {
  static constexpr std::pair<const char*, const char*> kDimensions[] = {
      {"rootz", "m"},  // above the start's 0.7 m
      {"rooty", "rad"},     {"bthigh", "rad"},     {"bshin", "rad"},      {"bfoot", "rad"},
      {"fthigh", "rad"},    {"fshin", "rad"},      {"ffoot", "rad"},      {"v-root-x", "m/s"},
      {"v-root-z", "m/s"},  {"v-rooty", "rad/s"},  {"v-bthigh", "rad/s"}, {"v-bshin", "rad/s"},
      {"v-bfoot", "rad/s"}, {"v-fthigh", "rad/s"}, {"v-fshin", "rad/s"},  {"v-ffoot", "rad/s"}};
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  SpaceSpec space;
  for (const auto& [name, unit] : kDimensions) {
    space.dimensions.push_back({name, unit, -kInfinity, kInfinity});
  }
  space.shape = {space.size()};
  return space;
}

EnvironmentSpec Describe(const Config& config) {
  EnvironmentSpec spec;
  spec.name = "HalfCheetah";
  spec.observation = ObservationSpace();
  for (const char* joint : {"bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"}) {
    spec.action.dimensions.push_back({joint, "", -1, 1});
  }
  spec.action.shape = {kJoints};
  spec.reward =
      "forward_reward_weight * (x_after - x_before) / 0.05 s - ctrl_cost_weight * sum(action^2)";
  spec.max_episode_steps = config.at("max_episode_steps").get<uint32_t>();
  spec.step_seconds = kStepSeconds;
  spec.reference_min = -280.178953;  // D4RL's
  spec.reference_max = 12135.0;
  return spec;
}

class HalfCheetahModel final : public EnvironmentModel {
 public:
  HalfCheetahModel(const Config& config, LoadedModel loaded)
      : spec_(Describe(config)),
        settings_{config.at("forward_reward_weight").get<double>(),
                  config.at("ctrl_cost_weight").get<double>(),
                  config.at("reset_noise_scale").get<double>()},
        loaded_(std::move(loaded)) {}

  const EnvironmentSpec& spec() const override { return spec_; }
  std::string Identity() const override { return loaded_.identity; }

  Result<std::unique_ptr<Environment>> NewEnvironment() const override {
    B4MRL_ASSIGN_OR_RETURN(MjDataPtr data, MakeMujocoData(*loaded_.model));
    return std::unique_ptr<Environment>(
        std::make_unique<HalfCheetah>(spec_, settings_, *loaded_.model, std::move(data)));
  }

 private:
  EnvironmentSpec spec_;
  Settings settings_;
  LoadedModel loaded_;
};

Result<std::shared_ptr<const EnvironmentModel>> Open(const EnvironmentSetup& setup) {
  B4MRL_ASSIGN_OR_RETURN(LoadedModel loaded, LoadMujocoModel(setup, kModelFile));
  const mjModel& model = *loaded.model;
  if (model.nq != int{kPositions} || model.nv != int{kPositions} || model.nu != int{kJoints}) {
    return Status(StatusCode::kDataLoss,
                  std::string(kModelFile) + " does not have 9 coordinates and 6 motors");
  }
  return std::shared_ptr<const EnvironmentModel>(
      std::make_shared<HalfCheetahModel>(setup.config, std::move(loaded)));
}

}  // namespace

extern const EnvironmentEntry kHalfCheetah;  // its line in list.cc
constinit const EnvironmentEntry kHalfCheetah = {"HalfCheetah", Complete, Describe, Open};

}  // namespace b4mrl
