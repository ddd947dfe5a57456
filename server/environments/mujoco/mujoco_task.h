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

#include <memory>
#include <string>
#include <utility>

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
  Result<std::unique_ptr<Environment>> NewEnvironment() const override {
    B4MRL_ASSIGN_OR_RETURN(MujocoScratch scratch, MujocoScratch::Create(loaded_));
    return std::unique_ptr<Environment>(
        std::make_unique<Task>(spec_, settings_, std::move(scratch)));
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
