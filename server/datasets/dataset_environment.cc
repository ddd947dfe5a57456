#include "server/datasets/dataset_environment.h"

#include <fmt/format.h>

#include <string_view>

#include "proto/base/names.h"
#include "server/environments/list.h"

namespace b4mrl {
namespace {

constexpr std::string_view kD4rlFolder = "d4rl/";

EnvironmentSpec UnnamedSpec(const std::string& environment, uint32_t observation_size,
                            uint32_t action_size) {
  const auto space = [](std::string_view prefix, uint32_t size) {
    SpaceSpec made;
    made.shape = {size};
    for (uint32_t i = 0; i < size; ++i) {
      made.dimensions.push_back({.name = fmt::format("{}-{}", prefix, i)});
    }
    return made;
  };
  EnvironmentSpec spec;
  spec.name = environment;
  spec.observation = space("observation", observation_size);
  spec.action = space("action", action_size);
  return spec;
}

}  // namespace

std::string EnvironmentOfName(const std::string& name) {
  const bool is_d4rl = name.starts_with(kD4rlFolder);
  const std::string rest = name.substr(is_d4rl ? kD4rlFolder.size() : 0);
  const std::string prefix = rest.substr(0, rest.find(is_d4rl ? '-' : '/'));
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    if ((is_d4rl ? LowerCase(std::string(entry.name)) : std::string(entry.name)) == prefix) {
      return std::string(entry.name);
    }
  }
  return "";
}

std::string EnvironmentOfText(const std::string& text) {
  const std::string name(WithoutVersion(text));
  return FindEnvironment(name).ok() ? name : text;
}

Result<EnvironmentSpec> SpecOfDataset(const std::string& name, const std::string& environment,
                                      uint32_t observation_size, uint32_t action_size) {
  const Result<EnvironmentSpec> spec = DescribeEnvironment(environment);
  if (!spec.ok()) {
    // Messages about presets name the environment, or the dataset's folder.
    const std::string named = environment.empty() ? name.substr(0, name.find('/')) : environment;
    return UnnamedSpec(named, observation_size, action_size);
  }
  if (spec->observation.size() == observation_size && spec->action.size() == action_size) {
    return spec;
  }
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("dataset '{}' has {} observation and {} action dimensions where {} "
                            "has {} and {}",
                            name, observation_size, action_size, spec->name,
                            spec->observation.size(), spec->action.size()));
}

Status CheckEnvironment(const std::string& name, const std::string& environment,
                        const TransitionColumns& columns, const std::string& wanted) {
  if (wanted.empty() || wanted == environment) return Status();
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec spec, DescribeEnvironment(wanted));
  if (!environment.empty()) {
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("dataset {} was recorded in {}, not in {}", name, environment, wanted));
  }
  return spec.CheckSizes(fmt::format("dataset {}", name), columns.observation_size,
                         columns.action_size);
}

}  // namespace b4mrl
