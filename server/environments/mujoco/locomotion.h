// What Gymnasium's MuJoCo runners share: constructor arguments, reward, health and infos. A task is
// a Locomotion subclass, a table of spaces and a line that makes an EnvironmentEntry of them
// (hopper.cc is the shortest).
//
//   reward       forward + survive - control cost - contact cost, summed in this order, where
//     forward    forward_reward_weight * (x_after - x_before) / dt, dt = timestep * frame_skip
//     survive    healthy_reward, in v4 also on the step that ends the episode; in v5 if healthy
//     control    ctrl_cost_weight * sum(action^2), of the action as given, although the motors clip
//                theirs
//   termination  unhealthy after the step, unless terminate_when_unhealthy is false
// Sums run in order and in double precision. Formulas and settings: Gymnasium 1.4.0's v4 and v5.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/environments/config_reader.h"
#include "server/environments/list.h"
#include "server/environments/mujoco/mujoco_environment.h"

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

  // Only of tasks that can fall.
  double healthy_reward = 0;
  bool terminate_when_unhealthy = true;
  Interval healthy_z;
  Interval healthy_angle;
  Interval healthy_state;

  // Only the Humanoid's, version 5.
  double contact_cost_weight = 0;
  Interval contact_cost_range;
  bool with_inertia = true;
  bool with_velocities = true;
  bool with_actuator_forces = true;
  bool with_contact_forces = true;
};

// The arguments that every task has; those of `settings` are the defaults and are replaced.
void ReadCommonSettings(ConfigReader& reader, LocomotionSettings* settings);
// healthy_reward, terminate_when_unhealthy and healthy_z_range.
void ReadHealthSettings(ConfigReader& reader, LocomotionSettings* settings);

// What an info column reports.
enum class Info {
  kX,  // of Position(), after the step
  kY,
  kDistance,  // of Position() from the origin
  kRootX,     // of qpos
  kRootY,
  kRootDistance,
  kHeightGain,  // qpos[1] above the model's
  kXVelocity,   // of Position(), averaged over the step
  kYVelocity,
  kForward,  // reward terms; costs are reported negative
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
  const EnvironmentSpec& spec() const override { return spec_; }
  void Infos(std::span<double> infos) const override;

  // What a version changes in the task's own compiled model; a task hides it with its own.
  static void AdaptModel(const LocomotionSettings& /*settings*/, mjModel* /*model*/) {}

 protected:
  using Point = std::array<double, 2>;  // x, y in m

  // All but `data` outlive the object.
  Locomotion(const EnvironmentSpec& spec, const LocomotionSettings& settings,
             std::span<const InfoColumn> infos, const mjModel& model, MjDataPtr data);

  const LocomotionSettings& settings() const { return settings_; }

  // qpos[0] unless a task measures its progress otherwise.
  virtual Point Position() const { return {data().qpos[0], 0}; }
  virtual bool Healthy() const { return true; }
  virtual double ContactCost() const { return 0; }
  // qpos and qvel plus U(-reset_noise_scale, reset_noise_scale), positions first.
  void DrawInitialState(Rng& rng, std::span<double> qpos, std::span<double> qvel) const override;

  // An overriding hook calls these.
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

struct ModelShape {
  int positions;
  int velocities;
  int motors;
  int bodies = 0;  // with the world; 0: any number
};

// The compiled model of a task and what its scratch simulators share. `Task` has
//   kModelFile, kShape                            the model that its code expects
//   ReadSettings(ConfigReader&)                   defaults and allowed arguments
//   Describe(settings)                            spaces, names, limits
//   InfoColumns(settings)                         static storage
// and a constructor (spec, settings, infos, model, data).
template <typename Task>
class LocomotionModel final : public EnvironmentModel {
 public:
  LocomotionModel(const LocomotionSettings& settings, LoadedModel loaded)
      : spec_(DescribeTask(settings)), settings_(settings), loaded_(std::move(loaded)) {
    spec_.step_seconds = loaded_.model->opt.timestep * settings_.frame_skip;
  }

  const EnvironmentSpec& spec() const override { return spec_; }
  std::string Identity() const override { return loaded_.identity; }
  Result<std::unique_ptr<Environment>> NewEnvironment() const override {
    B4MRL_ASSIGN_OR_RETURN(MjDataPtr data, MakeMujocoData(*loaded_.model));
    return std::unique_ptr<Environment>(std::make_unique<Task>(
        spec_, settings_, Task::InfoColumns(settings_), *loaded_.model, std::move(data)));
  }

  // The functions of an EnvironmentEntry.
  static Result<Config> Complete(const Config& config);
  static EnvironmentSpec Describe(const Config& config);
  static Result<std::shared_ptr<const EnvironmentModel>> Open(const EnvironmentSetup& setup);

 private:
  static EnvironmentSpec DescribeTask(const LocomotionSettings& settings);

  EnvironmentSpec spec_;
  LocomotionSettings settings_;
  LoadedModel loaded_;
};

// kDataLoss if a model file is not that of the task.
Status CheckModelShape(const LoadedModel& loaded, const char* own_file, const ModelShape& needed);
void DescribeInfos(std::span<const InfoColumn> columns, EnvironmentSpec* spec);

template <typename Task>
Result<Config> LocomotionModel<Task>::Complete(const Config& config) {
  ConfigReader reader(config);
  Task::ReadSettings(reader);
  B4MRL_RETURN_IF_ERROR(reader.Finish());
  return reader.completed();
}

template <typename Task>
EnvironmentSpec LocomotionModel<Task>::DescribeTask(const LocomotionSettings& settings) {
  EnvironmentSpec spec = Task::Describe(settings);
  spec.max_episode_steps = settings.max_episode_steps;
  DescribeInfos(Task::InfoColumns(settings), &spec);
  return spec;
}

template <typename Task>
EnvironmentSpec LocomotionModel<Task>::Describe(const Config& config) {
  ConfigReader reader(config);
  return DescribeTask(Task::ReadSettings(reader));
}

template <typename Task>
Result<std::shared_ptr<const EnvironmentModel>> LocomotionModel<Task>::Open(
    const EnvironmentSetup& setup) {
  ConfigReader reader(setup.config);
  const LocomotionSettings settings = Task::ReadSettings(reader);
  B4MRL_ASSIGN_OR_RETURN(LoadedModel loaded,
                         LoadMujocoModel(setup, Task::kModelFile, [&settings](mjModel* model) {
                           Task::AdaptModel(settings, model);
                         }));
  B4MRL_RETURN_IF_ERROR(CheckModelShape(loaded, Task::kModelFile, Task::kShape));
  loaded.pairs = ListCollisionPairs(loaded.model.get());
  return std::shared_ptr<const EnvironmentModel>(
      std::make_shared<LocomotionModel<Task>>(settings, std::move(loaded)));
}

}  // namespace b4mrl
