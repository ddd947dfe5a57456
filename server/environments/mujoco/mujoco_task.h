// The compiled model of a MuJoCo task and what its scratch simulators share, for any `Task` that
// has
//   Settings                         the task's settings, read from its configuration
//   kModelFile, kShape               the model that its code expects
//   ReadSettings(ConfigReader&)      -> Settings: defaults and allowed arguments
//   Describe(settings)               -> EnvironmentSpec: spaces, names, limits
//   AdaptModel(settings, mjModel*)   what the settings change in the task's own model
//   Task(spec, settings, MujocoScratch)
// all but the constructor static. The first two arguments of the constructor outlive the object.
// Immutable; any thread.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/environments/config_reader.h"
#include "server/environments/list.h"
#include "server/environments/mujoco/mujoco_model.h"

namespace b4mrl {

template <typename Task>
class MujocoTask final : public EnvironmentModel {
 public:
  using Settings = typename Task::Settings;

  MujocoTask(const Settings& settings, LoadedModel loaded)
      : spec_(SpecOf(settings)), settings_(settings), loaded_(std::move(loaded)) {}

  const EnvironmentSpec& spec() const override { return spec_; }
  std::string Identity() const override { return loaded_.identity; }
  size_t memory_bytes() const override { return BytesOf(*loaded_.model); }
  Result<std::unique_ptr<Environment>> NewEnvironment() const override {
    B4MRL_ASSIGN_OR_RETURN(MujocoScratch scratch, MujocoScratch::Create(loaded_));
    return std::unique_ptr<Environment>(
        std::make_unique<Task>(spec_, settings_, std::move(scratch)));
  }

  // Refuses a user's model that is unhealthy from its start on, as one is whose root's height does
  // not count from the floor.
  Status CheckStart() const override {
    if (loaded_.users_file.empty()) return Status();
    B4MRL_ASSIGN_OR_RETURN(const std::unique_ptr<Environment> environment, NewEnvironment());
    const mjModel& model = *loaded_.model;
    const std::vector<double> start(model.qpos0, model.qpos0 + model.nq);
    const std::vector<double> at_rest(static_cast<size_t>(model.nv), 0.0);
    B4MRL_RETURN_IF_ERROR(environment->SetNamedState({{"qpos", start}, {"qvel", at_rest}}));
    const std::vector<double> action(static_cast<size_t>(model.nu), 0.0);
    if (!environment->Step(action).terminated) return Status();
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("{} starts at qpos = ({:g}, ...), from where the first step ends each "
                    "episode as unhealthy, even with all motors at 0; allowed: a start "
                    "that the task's healthy ranges accept",
                    loaded_.users_file,
                    fmt::join(std::span(start).first(std::min<size_t>(3, start.size())), ", ")));
  }

  // The functions of an EnvironmentEntry.
  static Result<Config> Complete(const Config& config) {
    ConfigReader reader(config);
    Task::ReadSettings(reader);
    B4MRL_RETURN_IF_ERROR(reader.Finish());
    return reader.completed();
  }

  static EnvironmentSpec Describe(const Config& config) {
    ConfigReader reader(config);
    return SpecOf(Task::ReadSettings(reader));
  }

  static Result<std::shared_ptr<const EnvironmentModel>> Open(const EnvironmentSetup& setup) {
    ConfigReader reader(setup.config);
    const Settings settings = Task::ReadSettings(reader);
    B4MRL_ASSIGN_OR_RETURN(LoadedModel loaded,
                           LoadMujocoModel(setup, Task::kModelFile, [&settings](mjModel* model) {
                             Task::AdaptModel(settings, model);
                           }));
    B4MRL_RETURN_IF_ERROR(CheckModelShape(loaded, Task::kModelFile, Task::kShape));
    if (!loaded.change_copy) loaded.pairs = ListCollisionPairs(loaded.model.get());
    return std::shared_ptr<const EnvironmentModel>(
        std::make_shared<MujocoTask<Task>>(settings, std::move(loaded)));
  }

 private:
  static EnvironmentSpec SpecOf(const Settings& settings) {
    EnvironmentSpec spec = Task::Describe(settings);
    spec.features.emplace_back(kMujocoModel);
    return spec;
  }

  EnvironmentSpec spec_;
  Settings settings_;
  LoadedModel loaded_;
};

}  // namespace b4mrl
