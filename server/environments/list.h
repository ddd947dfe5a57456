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

// A user's model in compiled form, made by server/models/model_compiler.h. Empty: there is none.
struct CompiledModel {
  std::string path;
  std::string hash;  // of its content
};

// What an environment is opened from; only during open.
struct EnvironmentSetup {
  const Config& config;          // as completed by EnvironmentEntry::complete
  std::string users_model;       // the file that takes the place of the task's own; "" for none
  CompiledModel compiled_model;  // of that file
  // Changes the model that was loaded; never null. An error says what the model lacks.
  std::function<Status(mjModel_*)> change_model;
};

struct EnvironmentEntry {
  std::string_view name;
  // Checks the settings and fills in those left out; refuses unknown ones.
  Result<Config> (*complete)(const Config& config);
  // The task's spaces and limits under a completed configuration.
  EnvironmentSpec (*describe)(const Config& config);
  // Loads the model and applies the perturbations to it.
  Result<std::shared_ptr<const EnvironmentModel>> (*open)(const EnvironmentSetup& setup);
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
