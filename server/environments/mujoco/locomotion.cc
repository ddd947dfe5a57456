#include "server/environments/mujoco/locomotion.h"

#include <cmath>
#include <limits>

namespace b4mrl {
namespace {

constexpr double kLargestWeight = 1e6;

double Weight(ConfigReader& reader, const char* key, double fallback) {
  return reader.Number(key, fallback, -kLargestWeight, kLargestWeight);
}

}  // namespace

void ReadCommonSettings(ConfigReader& reader, LocomotionSettings* settings) {
  LocomotionSettings& s = *settings;
  s.v5 = reader.Choice("version", {"v4", "v5"}) == "v5";
  s.forward_reward_weight = Weight(reader, "forward_reward_weight", s.forward_reward_weight);
  s.ctrl_cost_weight = Weight(reader, "ctrl_cost_weight", s.ctrl_cost_weight);
  s.reset_noise_scale = reader.Number("reset_noise_scale", s.reset_noise_scale, 0, 10);
  s.frame_skip = static_cast<int>(reader.Integer("frame_skip", s.frame_skip, 1, 100));
  s.with_positions = !reader.Bool("exclude_current_positions_from_observation", true);
  s.max_episode_steps = static_cast<uint32_t>(reader.Integer(
      "max_episode_steps", s.max_episode_steps, 1, std::numeric_limits<uint32_t>::max()));
}

void ReadHealthSettings(ConfigReader& reader, LocomotionSettings* settings) {
  LocomotionSettings& s = *settings;
  s.healthy_reward = Weight(reader, "healthy_reward", s.healthy_reward);
  s.terminate_when_unhealthy = reader.Bool("terminate_when_unhealthy", s.terminate_when_unhealthy);
  s.healthy_z = reader.Range("healthy_z_range", s.healthy_z);
}

Locomotion::Locomotion(const EnvironmentSpec& spec, const LocomotionSettings& settings,
                       std::span<const InfoColumn> infos, MujocoScratch scratch)
    : MujocoEnvironment(std::move(scratch), settings.frame_skip),
      spec_(spec),
      settings_(settings),
      infos_(infos) {}

void Locomotion::DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const {
  const double scale = settings_.reset_noise_scale;
  for (double& x : qpos) x += rng.Uniform(-scale, scale);
  for (double& v : qvel) v += rng.Uniform(-scale, scale);
}

StepResult Locomotion::Judge(std::span<const double> action) {
  const Point after = Position();
  double squares = 0;
  for (const double a : action) squares += a * a;
  const bool healthy = Healthy();
  const bool paid = healthy || (!settings_.v5 && settings_.terminate_when_unhealthy);
  Terms terms;
  terms.x_velocity = (after[0] - before_[0]) / step_seconds();
  terms.y_velocity = (after[1] - before_[1]) / step_seconds();
  terms.forward = settings_.forward_reward_weight * terms.x_velocity;
  terms.survive = paid ? settings_.healthy_reward : 0;
  terms.control_cost = settings_.ctrl_cost_weight * squares;
  terms.contact_cost = ContactCost();
  terms_ = terms;
  const bool terminated = !healthy && settings_.terminate_when_unhealthy;
  return {.reward = terms.forward + terms.survive - terms.control_cost - terms.contact_cost,
          .terminated = terminated,
          .cause = terminated ? Cause::kUnhealthy : Cause::kNone};
}

void Locomotion::Infos(std::span<double> infos) const {
  for (size_t i = 0; i < infos.size(); ++i) {
    const bool there = terms_.has_value() || infos_[i].at_reset;
    infos[i] = there ? Value(infos_[i].info, terms_.value_or(Terms{})) : 0;
  }
}

double Locomotion::Value(Info info, const Terms& terms) const {
  const double* qpos = data().qpos;
  const auto distance = [](double x, double y) { return std::sqrt(x * x + y * y); };
  const auto tendon = [this](const double* values, int index) {
    return index < model().ntendon ? values[index] : 0;
  };
  switch (info) {
    case Info::kX:
      return Position()[0];
    case Info::kY:
      return Position()[1];
    case Info::kDistance:
      return distance(Position()[0], Position()[1]);
    case Info::kRootX:
      return qpos[0];
    case Info::kRootY:
      return qpos[1];
    case Info::kRootDistance:
      return distance(qpos[0], qpos[1]);
    case Info::kHeightGain:
      return qpos[1] - model().qpos0[1];
    case Info::kXVelocity:
      return terms.x_velocity;
    case Info::kYVelocity:
      return terms.y_velocity;
    case Info::kForward:
      return terms.forward;
    case Info::kSurvive:
      return terms.survive;
    case Info::kControl:
      return -terms.control_cost;
    case Info::kContact:
      return -terms.contact_cost;
    case Info::kTendonLength0:
    case Info::kTendonLength1:
      return tendon(data().ten_length, info == Info::kTendonLength1);
    case Info::kTendonVelocity0:
    case Info::kTendonVelocity1:
      return tendon(data().ten_velocity, info == Info::kTendonVelocity1);
  }
  return 0;
}

void DescribeLocomotion(const LocomotionSettings& settings, std::span<const InfoColumn> columns,
                        EnvironmentSpec* spec) {
  spec->max_episode_steps = settings.max_episode_steps;
  for (const InfoColumn& column : columns) {
    spec->info_names.emplace_back(column.name);
    if (column.at_reset) spec->reset_info_names.emplace_back(column.name);
  }
}

}  // namespace b4mrl
