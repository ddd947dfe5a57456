#include "server/gateway/suite_check.h"

#include <fmt/format.h>

#include <array>
#include <map>
#include <set>
#include <string>
#include <tuple>

#include "server/environments/list.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

Status CheckText(const std::string& text, const EnvironmentSpec& spec, PerturbationUse use) {
  B4MRL_ASSIGN_OR_RETURN(const auto items, ParseNamedArguments(text));
  return MakePerturbations(items, spec, use).status();
}

}  // namespace

Status CheckSuites(const std::vector<Benchmark>& benchmarks) {
  std::map<std::string, EnvironmentSpec> specs;
  // Most benchmarks of a suite differ in one of several texts.
  std::set<std::tuple<std::string, std::string, PerturbationUse>> checked;
  for (const Benchmark& benchmark : benchmarks) {
    if (!specs.contains(benchmark.environment)) {
      auto spec = DescribeEnvironment(benchmark.environment);
      if (!spec.ok()) return spec.status().WithContext("benchmark " + benchmark.name);
      specs.emplace(benchmark.environment, *std::move(spec));
    }
    const std::array<std::tuple<const char*, const std::string&, PerturbationUse>, 3> entries = {{
        {"simulators", benchmark.simulator, PerturbationUse::kSimulator},
        {"world", benchmark.world, PerturbationUse::kSimulator},
        {"corruptions", benchmark.corruption, PerturbationUse::kDataset},
    }};
    for (const auto& [key, text, use] : entries) {
      if (!checked.emplace(benchmark.environment, text, use).second) continue;
      const Status status = CheckText(text, specs.at(benchmark.environment), use);
      if (status.ok()) continue;
      return status.WithContext(fmt::format("benchmark {}, {}", benchmark.name, key));
    }
  }
  return Status();
}

}  // namespace b4mrl
