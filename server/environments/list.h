// The table of all environments. Adding an environment takes a .cc file and a line in list.cc.
// Everything here but EnvironmentEntry::open works without the physics engine. Any thread.
#pragma once

#include <cstdint>
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

// Features of an environment (EnvironmentSpec::features) that a perturbation may need.
inline constexpr std::string_view kMujocoModel = "a MuJoCo model";
inline constexpr std::string_view kLowerLegs = "lower legs";
inline constexpr std::string_view kOtherCars = "other cars";

// A user's MuJoCo model, compiled by server/models/model_compiler.h. Both texts are "" without one.
struct CompiledModel {
  std::string path;
  std::string hash;  // of the compiled file's content
};

// The arguments of EnvironmentEntry::open. Any thread may call the functions, which stay valid as
// long as the EnvironmentModel and its Environments; the other members last only during open.
struct EnvironmentSetup {
  const Config& config;          // as completed by EnvironmentEntry::complete, under `parameters`
  std::string users_model = {};  // MJCF file that replaces the task's own; "" for none
  CompiledModel compiled_model = {};  // users_model, compiled
  // The numbers that perturbations draw anew for each episode, each at the upper end of its range;
  // empty if none is drawn. These numbers decide the environment's spaces and sizes.
  std::vector<double> parameters = {};
  // The completed settings under other `parameters`; called only if numbers are drawn.
  std::function<Config(std::span<const double> parameters)> config_under = {};
  // Applies the perturbations, with these parameters, to a model. An error says what the model
  // lacks.
  std::function<Status(std::span<const double> parameters, mjModel_*)> change_model =
      [](std::span<const double>, mjModel_*) { return Status(); };
};

// A short name for a perturbation with a fixed argument: the strength that the paper gives to an
// error of one environment's simulator or dataset.
struct Preset {
  std::string_view name;         // "obs-noise-low"; "gravity" without an argument is a preset too
  std::string_view environment;  // "HalfCheetah"
  std::string_view parametric;   // the perturbation: "obs-noise"
  std::string_view argument;     // "0.01"
};

struct EnvironmentEntry {
  std::string_view name;
  // Checks the settings and fills in defaults; refuses unknown keys.
  Result<Config> (*complete)(const Config& config);
  // The task's spaces and limits under a completed configuration.
  EnvironmentSpec (*describe)(const Config& config);
  // Loads the model and applies the perturbations to it.
  Result<std::shared_ptr<const EnvironmentModel>> (*open)(const EnvironmentSetup& setup);
  // Presets of this environment that no perturbation's own file has.
  std::span<const Preset> presets = {};
  // The number in "HalfCheetah-v0": raised when a change of spaces or dynamics makes old data and
  // results incomparable.
  uint32_t version = 0;
};

// All environments, in the catalogue's order.
std::span<const EnvironmentEntry> EnvironmentList();
// The entry of that name; else kUnknownName, with the nearest known name.
Result<const EnvironmentEntry*> FindEnvironment(std::string_view name);
// The environment's specification under its default configuration.
Result<EnvironmentSpec> DescribeEnvironment(std::string_view name);

// The folder of users' MJCF files unless another one is given, which holds the tasks' own as a
// start: the installed one, else data/models of the checkout.
std::string DefaultModelsFolder();

}  // namespace b4mrl
