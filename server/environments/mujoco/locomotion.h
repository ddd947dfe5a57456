// What Gymnasium's MuJoCo runners share: constructor arguments, reward, health and infos. A task is
// a Locomotion subclass, a table of spaces and an EnvironmentEntry made of both by MujocoTask
// (hopper.cc is the shortest).
//
//   reward       forward + survive - control cost - contact cost, summed in this order, where
//     forward    forward_reward_weight * (x_after - x_before) / dt, dt = timestep * frame_skip
//     survive    healthy_reward, in v4 also on the step that ends the episode; in v5 if healthy
//     control    ctrl_cost_weight * sum(action^2), of the action before the motors clip it
//   termination  unhealthy after the step, unless terminate_when_unhealthy is false
// Sums run in order and in double precision. Formulas and settings: Gymnasium 1.4.0's v4 and v5.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "server/environments/config_reader.h"
#include "server/environments/mujoco/mujoco_environment.h"
#include "server/environments/mujoco/mujoco_task.h"

namespace b4mrl {

// Gymnasium's constructor arguments. A task's defaults stand in its own file.
struct LocomotionSettings {
  bool v5 = false;
  double forward_reward_weight = 1;
  double ctrl_cost_weight = 0;
  double reset_noise_scale = 0;
  int frame_skip = 1;
  bool with_positions = false;  // not exclude_current_positions_from_observation
  uint32_t max_episode_steps = 1000;

  // Settings of the tasks that can fall, used by no other.
  double healthy_reward = 0;
  bool terminate_when_unhealthy = true;
  Interval healthy_z;
  Interval healthy_angle;
  Interval healthy_state;
};

// Reads the arguments that every runner has; `settings` holds the defaults and gets the values.
void ReadCommonSettings(ConfigReader& reader, LocomotionSettings* settings);
// Reads healthy_reward, terminate_when_unhealthy and healthy_z_range in the same way.
void ReadHealthSettings(ConfigReader& reader, LocomotionSettings* settings);

// What an info column reports.
enum class Info {
  kX,  // of Position(), after the step, m
  kY,
  kDistance,  // of Position() from the origin, m
  kRootX,     // qpos[0], m
  kRootY,
  kRootDistance,
  kHeightGain,  // qpos[1] above the model's initial one, m
  kXVelocity,   // of Position(), averaged over the step, m/s
  kYVelocity,
  kForward,  // first of the four reward terms; costs are reported negative
  kSurvive,
  kControl,
  kContact,
  kTendonLength0,
  kTendonLength1,
  kTendonVelocity0,
  kTendonVelocity1,
};
struct InfoColumn {
  const char* name;
  Info info;
  bool at_reset = false;
};

class Locomotion : public MujocoEnvironment {
 public:
  using Settings = LocomotionSettings;

  const EnvironmentSpec& spec() const override { return spec_; }
  void Infos(std::span<double> infos) const override;

  // Version-dependent changes of the task's own compiled model: none here. A task with such changes
  // hides this function by its own.
  static void AdaptModel(const LocomotionSettings& /*settings*/, mjModel* /*model*/) {}

 protected:
  using Point = std::array<double, 2>;  // x, y in m

  // All but `scratch` outlive the object.
  Locomotion(const EnvironmentSpec& spec, const LocomotionSettings& settings,
             std::span<const InfoColumn> infos, MujocoScratch scratch);

  const LocomotionSettings& settings() const { return settings_; }

  // The point whose motion along x is the task's progress: qpos[0] unless overridden.
  virtual Point Position() const { return {data().qpos[0], 0}; }
  virtual bool Healthy() const { return true; }
  virtual double ContactCost() const { return 0; }
  // Adds U(-reset_noise_scale, reset_noise_scale) to each number of qpos, then of qvel.
  void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const override;

  // A task that overrides one of these two hooks calls it.
  void BeforeStep() override { before_ = Position(); }
  void AfterForward() override { terms_.reset(); }

 private:
  struct Terms {
    double x_velocity = 0, y_velocity = 0;  // m/s
    double forward = 0, survive = 0, control_cost = 0, contact_cost = 0;
  };

  StepResult Judge(std::span<const double> action) final;
  double Value(Info info, const Terms& terms) const;

  const EnvironmentSpec& spec_;
  const LocomotionSettings& settings_;
  std::span<const InfoColumn> infos_;
  Point before_{};
  std::optional<Terms> terms_;  // of the last step; none after a reset
};

// Fills in what follows from the settings and info columns alone: step limit and info names.
void DescribeLocomotion(const LocomotionSettings& settings, std::span<const InfoColumn> columns,
                        EnvironmentSpec* spec);

}  // namespace b4mrl
