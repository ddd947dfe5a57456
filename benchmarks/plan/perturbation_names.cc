#include "benchmarks/plan/perturbation_names.h"

#include <algorithm>
#include <set>
#include <vector>

#include "proto/base/spec.h"

namespace b4mrl {

Result<std::string> Parametric(const std::string& text, const std::string& environment,
                               const pb::CatalogueReply& catalogue) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<NamedArgument> items, ParseNamedArguments(text));
  for (NamedArgument& item : items) {
    for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
      for (const pb::PresetInfo& preset : info.presets()) {
        const bool is_meant = item.argument.empty() && preset.name() == item.name &&
                              preset.environment() == environment;
        if (is_meant) item = {info.name(), preset.argument()};
      }
    }
  }
  return FormatNamedArguments(items);
}

Result<std::string> ByPresets(const std::string& text, const std::string& environment,
                              const pb::CatalogueReply& catalogue) {
  B4MRL_ASSIGN_OR_RETURN(const std::string parametric, Parametric(text, environment, catalogue));
  B4MRL_ASSIGN_OR_RETURN(std::vector<NamedArgument> items, ParseNamedArguments(parametric));
  for (NamedArgument& item : items) {
    for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
      if (info.name() != item.name) continue;
      const auto preset = std::ranges::find_if(info.presets(), [&](const pb::PresetInfo& each) {
        return each.environment() == environment && each.argument() == item.argument;
      });
      if (preset == info.presets().end()) continue;
      item = {preset->name(), ""};
      break;
    }
  }
  return FormatNamedArguments(items);
}

Status CheckPerturbations(const std::string& text, const pb::CatalogueReply& catalogue) {
  std::set<std::string> names;
  for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
    names.insert(info.name());
    for (const pb::PresetInfo& preset : info.presets()) names.insert(preset.name());
  }
  B4MRL_ASSIGN_OR_RETURN(const auto items, ParseNamedArguments(text));
  for (const NamedArgument& item : items) {
    if (names.contains(item.name)) continue;
    return UnknownName("perturbation", item.name, names);
  }
  return Status();
}

}  // namespace b4mrl
