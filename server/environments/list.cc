#include "server/environments/list.h"

#include <nlohmann/json.hpp>

#include "proto/base/folders.h"

namespace b4mrl {

// One line for each environment: the name of the entry that its own file defines.
#define B4MRL_ENVIRONMENTS(ENTRY) \
  ENTRY(kHalfCheetah)             \
  ENTRY(kHopper)                  \
  ENTRY(kWalker2d)                \
  ENTRY(kHumanoid)                \
  ENTRY(kHighway)

#define DECLARE(name) extern const EnvironmentEntry name;
B4MRL_ENVIRONMENTS(DECLARE)
#undef DECLARE

std::span<const EnvironmentEntry> EnvironmentList() {
#define NAME_WITH_COMMA(name) name,
  static const EnvironmentEntry kList[] = {B4MRL_ENVIRONMENTS(NAME_WITH_COMMA)};
#undef NAME_WITH_COMMA
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
  // The folder is looked up once: a process keeps it, also when its program's file is replaced.
  static const std::string folder = SharedFolder("models", B4MRL_MODELS_FOLDER);
  return folder;
}

}  // namespace b4mrl
