// The table of environments: the one place that knows them all. Adding one is a .cc file and a line
// in list.cc. Everything here but EnvironmentEntry::open works without the physics engine. Any
// thread.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/environments/config.h"
#include "server/environments/environment.h"

struct mjModel_;  // MuJoCo's mjModel

namespace b4mrl {

// What perturbations may need of an environment: EnvironmentSpec::features.
inline constexpr std::string_view kMujocoModel = "a MuJoCo model";
inline constexpr std::string_view kLowerLegs = "lower legs";
inline constexpr std::string_view kOtherCars = "other cars";

// A user's model in compiled form, made by server/models/model_compiler.h. Empty: there is none.
struct CompiledModel {
  std::string path;
  std::string hash;  // of its content
};

// What an environment is opened from. The functions may be called by any thread and stay valid as
// long as the EnvironmentModel and its Environments; all else lasts only during open.
struct EnvironmentSetup {
  const Config& config;          // as completed by EnvironmentEntry::complete, under `parameters`
  std::string users_model = {};  // the file that takes the place of the task's own; "" for none
  CompiledModel compiled_model = {};  // of that file
  // The numbers that are drawn anew for each episode, each at the upper end of its range; empty
  // where all are fixed. Spaces and sizes of the environment are those under these numbers.
  std::vector<double> parameters = {};
  // The settings under other numbers, completed; called only where there are parameters.
  std::function<Config(std::span<const double> parameters)> config_under = {};
  // Changes the model that was loaded as these numbers want it. An error says what it lacks.
  std::function<Status(std::span<const double> parameters, mjModel_*)> change_model =
      [](std::span<const double>, mjModel_*) { return Status(); };
};

// A perturbation with its argument under a name of its own: how strong an error of an environment's
// simulator or data is in the paper.
struct Preset {
  std::string_view name;         // "obs-noise-low"; "gravity" without an argument is a preset too
  std::string_view environment;  // "HalfCheetah"
  std::string_view parametric;   // the perturbation: "obs-noise"
  std::string_view argument;     // "0.01"
};

struct EnvironmentEntry {
  std::string_view name;
  // Checks the settings and fills in those left out; refuses unknown ones.
  Result<Config> (*complete)(const Config& config);
  // The task's spaces and limits under a completed configuration.
  EnvironmentSpec (*describe)(const Config& config);
  // Loads the model and applies the perturbations to it.
  Result<std::shared_ptr<const EnvironmentModel>> (*open)(const EnvironmentSetup& setup);
  // Presets of this environment that no perturbation's own file has.
  std::span<const Preset> presets = {};
};

// In the catalogue's order.
std::span<const EnvironmentEntry> EnvironmentList();
// kUnknownName with the nearest known one.
Result<const EnvironmentEntry*> FindEnvironment(std::string_view name);
// The specification under the default configuration.
Result<EnvironmentSpec> DescribeEnvironment(std::string_view name);

// The folder with the tasks' own MJCF files, and the users' when none is given: the installation's,
// else the checkout's data/models.
std::string DefaultModelsFolder();

}  // namespace b4mrl
