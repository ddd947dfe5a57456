#include "server/perturbations/list.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "proto/base/limits.h"
#include "server/perturbations/hidden_dimensions.h"

namespace b4mrl {

// Each is defined in the perturbation's own file.
extern const PerturbationEntry kGravity;
extern const PerturbationEntry kFriction;
extern const PerturbationEntry kObservationNoise;
extern const PerturbationEntry kHiddenDimensions;

std::span<const PerturbationEntry> PerturbationList() {
  static const std::array kList = {kGravity, kFriction, kObservationNoise, kHiddenDimensions};
  return kList;
}

std::span<const PerturbationPreset> PresetList() {
  // The paper's values.
  static constexpr PerturbationPreset kPresets[] = {
      {"gravity", "HalfCheetah", "gravity", "2"},
      {"friction", "HalfCheetah", "friction", "0.3"},
      {"obs-noise-low", "HalfCheetah", "obs-noise", "0.01"},
      {"obs-noise-high", "HalfCheetah", "obs-noise", "0.05"},
      {"hidden-low", "HalfCheetah", "hidden", "16"},
      {"hidden-high", "HalfCheetah", "hidden", "9"},
  };
  return kPresets;
}

namespace {

std::span<const MissingPreset> MissingPresets() {
  static constexpr MissingPreset kMissing[] = {
      {"leg", "HalfCheetah", "the paper shortens the leg of the one-legged Hopper alone"},
      {"cars", "HalfCheetah", "only the Highway has other cars"},
  };
  return kMissing;
}

const PerturbationEntry* FindEntry(std::string_view name) {
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (entry.name == name) return &entry;
  }
  return nullptr;
}

// "gravity=FACTOR, friction=FACTOR, ..."
std::string ParametricForms() {
  std::string forms;
  for (const PerturbationEntry& entry : PerturbationList()) {
    forms += fmt::format("{}{}=<{}>", forms.empty() ? "" : ", ", entry.name, entry.parameter);
  }
  return forms;
}

// Why `name`, which is no preset of `environment` and no parametric form with an argument, is
// refused.
Status RefusePreset(std::string_view name, std::string_view environment) {
  for (const MissingPreset& missing : MissingPresets()) {
    if (missing.name != name || missing.environment != environment) continue;
    return Status(StatusCode::kUnsupported,
                  fmt::format("{} has no perturbation '{}': {}; it takes {}", environment, name,
                              missing.reason, ParametricForms()));
  }
  std::string_view parametric = FindEntry(name) != nullptr ? name : "";
  for (const PerturbationPreset& preset : PresetList()) {
    if (preset.name == name) parametric = preset.parametric;
  }
  if (const PerturbationEntry* entry = FindEntry(parametric)) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("{} has no preset '{}'; give a value: {}=<{}>", environment, name,
                              entry->name, entry->parameter));
  }
  std::set<std::string_view> known;
  for (const PerturbationPreset& preset : PresetList()) known.insert(preset.name);
  for (const PerturbationEntry& entry : PerturbationList()) known.insert(entry.name);
  return UnknownName("perturbation", name, known);
}

}  // namespace

Result<NamedArgument> ResolvePerturbation(const NamedArgument& item, std::string_view environment) {
  if (!item.argument.empty()) {
    if (FindEntry(item.name) != nullptr) return item;
    for (const PerturbationPreset& preset : PresetList()) {
      if (preset.name != item.name) continue;
      return InvalidArgument(fmt::format("argument of preset '{}'", item.name), item.argument,
                             fmt::format("none, or {}={}", preset.parametric, item.argument));
    }
    return RefusePreset(item.name, environment);
  }
  for (const PerturbationPreset& preset : PresetList()) {
    if (preset.name == item.name && preset.environment == environment) {
      return NamedArgument{std::string(preset.parametric), std::string(preset.argument)};
    }
  }
  return RefusePreset(item.name, environment);
}

Result<PerturbationSet> MakePerturbations(std::span<const NamedArgument> items,
                                          const EnvironmentSpec& spec, PerturbationUse use) {
  if (items.size() > limits::kMaxPerturbations) {
    return Status(StatusCode::kLimitExceeded, fmt::format("{} perturbations, allowed: {}",
                                                          items.size(), limits::kMaxPerturbations));
  }
  std::vector<std::unique_ptr<Perturbation>> members;
  std::map<std::string, uint64_t> occurrences;
  for (const NamedArgument& written : items) {
    B4MRL_ASSIGN_OR_RETURN(const NamedArgument item, ResolvePerturbation(written, spec.name));
    const PerturbationEntry& entry = *FindEntry(item.name);
    if (use == PerturbationUse::kDataset && !entry.corrupts_datasets) {
      return Status(
          StatusCode::kUnsupported,
          fmt::format("'{}' changes a simulator and cannot corrupt a dataset", written.ToString()));
    }
    const PerturbationInput input = {&spec, item.argument, occurrences[item.name]++};
    B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<Perturbation> member, entry.make(input));
    members.push_back(std::move(member));
  }
  return PerturbationSet(spec, std::move(members));
}

Result<std::vector<uint32_t>> HiddenDimensions(std::span<const NamedArgument> items,
                                               const EnvironmentSpec& spec) {
  std::set<uint32_t> hidden;
  for (const NamedArgument& written : items) {
    B4MRL_ASSIGN_OR_RETURN(const NamedArgument item, ResolvePerturbation(written, spec.name));
    if (item.name != kHiddenDimensions.name) continue;
    B4MRL_ASSIGN_OR_RETURN(const std::vector<uint32_t> dimensions,
                           ParseDimensions(item.argument, spec));
    hidden.insert(dimensions.begin(), dimensions.end());
  }
  return std::vector<uint32_t>(hidden.begin(), hidden.end());
}

}  // namespace b4mrl
