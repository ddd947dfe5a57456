#include "server/environments/mujoco/planar_runner.h"

#include <algorithm>
#include <string>

namespace b4mrl {

void PlanarRunner::Observe(std::span<double> observation) const {
  const int skipped = settings().with_positions ? 0 : 1;
  double* out = std::copy_n(data().qpos + skipped, model().nq - skipped, observation.data());
  std::transform(data().qvel, data().qvel + model().nv, out,
                 [this](double v) { return std::clamp(v, -velocity_limit_, velocity_limit_); });
}

void PlanarRunner::StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                                        std::span<double> qvel) const {
  const size_t skipped = settings().with_positions ? 0 : 1;
  const size_t positions = qpos.size() - skipped;
  std::ranges::copy(observation.first(positions), qpos.begin() + skipped);
  std::ranges::copy(observation.subspan(positions), qvel.begin());
}

EnvironmentSpec DescribePlanarRunner(const char* name, std::span<const char* const> joints,
                                     const LocomotionSettings& settings) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EnvironmentSpec spec;
  spec.name = name;
  const auto add = [&spec](const std::string& dimension, const char* unit) {
    spec.observation.dimensions.push_back({dimension, unit, -kInfinity, kInfinity});
  };
  if (settings.with_positions) add("rootx", "m");
  add("rootz", "m");
  add("rooty", "rad");
  for (const char* joint : joints) add(joint, "rad");
  add("v-root-x", "m/s");
  add("v-root-z", "m/s");
  add("v-rooty", "rad/s");
  for (const char* joint : joints) {
    add(std::string("v-") + joint, "rad/s");
    spec.action.dimensions.push_back({joint, "", -1, 1});
  }
  spec.observation.shape = {spec.observation.size()};
  spec.action.shape = {spec.action.size()};
  return spec;
}

LocomotionSettings ReadPlanarWalkerSettings(ConfigReader& reader, Interval healthy_z,
                                            Interval healthy_angle) {
  LocomotionSettings settings;
  settings.forward_reward_weight = 1;
  settings.ctrl_cost_weight = 1e-3;
  settings.reset_noise_scale = 5e-3;
  settings.frame_skip = 4;
  settings.healthy_reward = 1;
  settings.healthy_z = healthy_z;
  ReadCommonSettings(reader, &settings);
  ReadHealthSettings(reader, &settings);
  settings.healthy_angle = reader.Range("healthy_angle_range", healthy_angle);
  return settings;
}

std::span<const InfoColumn> PlanarWalkerInfos(const LocomotionSettings& settings) {
  static constexpr InfoColumn kV4[] = {{"x_position", Info::kX}, {"x_velocity", Info::kXVelocity}};
  static constexpr InfoColumn kV5[] = {
      {"x_position", Info::kX, true},   {"z_distance_from_origin", Info::kHeightGain, true},
      {"x_velocity", Info::kXVelocity}, {"reward_forward", Info::kForward},
      {"reward_ctrl", Info::kControl},  {"reward_survive", Info::kSurvive}};
  return settings.v5 ? std::span<const InfoColumn>(kV5) : std::span<const InfoColumn>(kV4);
}

void DescribePlanarWalker(const LocomotionSettings& settings, EnvironmentSpec* spec) {
  DescribeLocomotion(settings, PlanarWalkerInfos(settings), spec);
  spec->features.emplace_back(kLowerLegs);
  spec->reward =
      "forward_reward_weight * (x_after - x_before) / dt + healthy_reward - "
      "ctrl_cost_weight * sum(action^2)";
  spec->termination.emplace();
  if (!settings.terminate_when_unhealthy) return;
  const uint32_t height = HeightDimension(settings);
  spec->termination->push_back({height, settings.healthy_z.low, settings.healthy_z.high});
  spec->termination->push_back(
      {height + 1, settings.healthy_angle.low, settings.healthy_angle.high});
}

}  // namespace b4mrl
