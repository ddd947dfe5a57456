#include "server/environments/list.h"

#include <array>
#include <nlohmann/json.hpp>

#include "proto/base/folders.h"

namespace b4mrl {

// Each is defined in the environment's own file.
extern const EnvironmentEntry kHalfCheetah;
extern const EnvironmentEntry kHopper;
extern const EnvironmentEntry kWalker2d;
extern const EnvironmentEntry kHumanoid;
extern const EnvironmentEntry kHighway;

std::span<const EnvironmentEntry> EnvironmentList() {
  static const std::array kList = {kHalfCheetah, kHopper, kWalker2d, kHumanoid, kHighway};
  return kList;
}

Result<const EnvironmentEntry*> FindEnvironment(std::string_view name) {
  std::vector<std::string_view> known;
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    if (entry.name == name) return &entry;
    known.push_back(entry.name);
  }
  return UnknownName("environment", name, known);
}

Result<EnvironmentSpec> DescribeEnvironment(std::string_view name) {
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentEntry* entry, FindEnvironment(name));
  B4MRL_ASSIGN_OR_RETURN(const Config config, entry->complete(Config::object()));
  return entry->describe(config);
}

std::string DefaultModelsFolder() {
  // Looked up once: a process keeps its folder, also when its program's file is replaced.
  static const std::string folder = SharedFolder("models", B4MRL_MODELS_FOLDER);
  return folder;
}

}  // namespace b4mrl
