#include "server/perturbations/list.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/perturbations/hidden_dimensions.h"

namespace b4mrl {

// Each is defined in the perturbation's own file.
extern const PerturbationEntry kGravity;
extern const PerturbationEntry kFriction;
extern const PerturbationEntry kLegLength;
extern const PerturbationEntry kUsersModel;
extern const PerturbationEntry kCars;
extern const PerturbationEntry kObservationNoise;
extern const PerturbationEntry kHiddenDimensions;
extern const PerturbationEntry kActionNoise;
extern const PerturbationEntry kActionDelay;

std::span<const PerturbationEntry> PerturbationList() {
  static const std::array kList = {kGravity,          kFriction,    kLegLength,
                                   kUsersModel,        kCars,        kObservationNoise,
                                   kHiddenDimensions, kActionNoise, kActionDelay};
  return kList;
}

std::span<const PerturbationPreset> PresetList() {
  // The paper's values; the delay is ours, for it gives none.
  static constexpr PerturbationPreset kPresets[] = {
      {"gravity", "HalfCheetah", "gravity", "2"},
      {"gravity", "Hopper", "gravity", "2"},
      {"gravity", "Walker2d", "gravity", "2"},
      {"friction", "HalfCheetah", "friction", "0.3"},
      {"friction", "Walker2d", "friction", "0.3"},
      {"leg", "Hopper", "leg", "0.8"},
      {"cars", "Highway", "cars", "15"},
      {"obs-noise-low", "HalfCheetah", "obs-noise", "0.01"},
      {"obs-noise-low", "Hopper", "obs-noise", "0.001"},
      {"obs-noise-low", "Walker2d", "obs-noise", "0.01"},
      {"obs-noise-low", "Highway", "obs-noise", "0.5"},
      {"obs-noise-high", "HalfCheetah", "obs-noise", "0.05"},
      {"obs-noise-high", "Hopper", "obs-noise", "0.02"},
      {"obs-noise-high", "Walker2d", "obs-noise", "0.03"},
      {"obs-noise-high", "Highway", "obs-noise", "1"},
      {"hidden-low", "HalfCheetah", "hidden", "16"},
      {"hidden-low", "Hopper", "hidden", "9"},
      {"hidden-low", "Walker2d", "hidden", "16"},
      {"hidden-low", "Highway", "hidden", "vx+vy"},
      {"hidden-high", "HalfCheetah", "hidden", "9"},
      {"hidden-high", "Hopper", "hidden", "10"},
      {"hidden-high", "Walker2d", "hidden", "9"},
      {"hidden-high", "Highway", "hidden", "y+vx+vy"},
      {"action-noise-low", "HalfCheetah", "action-noise", "0.2"},
      {"action-noise-low", "Hopper", "action-noise", "0.5"},
      {"action-noise-low", "Walker2d", "action-noise", "0.2"},
      {"action-noise-low", "Highway", "action-noise", "0.5"},
      {"action-noise-high", "HalfCheetah", "action-noise", "0.5"},
      {"action-noise-high", "Hopper", "action-noise", "1"},
      {"action-noise-high", "Walker2d", "action-noise", "0.5"},
      {"action-noise-high", "Highway", "action-noise", "1"},
      {"action-delay", "HalfCheetah", "action-delay", "2"},
      {"action-delay", "Hopper", "action-delay", "2"},
      {"action-delay", "Walker2d", "action-delay", "2"},
      {"action-delay", "Humanoid", "action-delay", "2"},
      {"action-delay", "Highway", "action-delay", "2"},
  };
  return kPresets;
}

bool Applies(const PerturbationEntry& entry, const EnvironmentSpec& spec) {
  return entry.applies == nullptr || entry.applies(spec);
}

bool HasModel(const EnvironmentSpec& spec) { return spec.has_model; }

namespace {

// The first that fits is told.
std::span<const MissingPreset> MissingPresets() {
  static constexpr std::string_view kNoModel = "the cars of Highway are not a MuJoCo model";
  static constexpr std::string_view kNoLeg = "the paper shortens the leg of the Hopper alone";
  static constexpr std::string_view kNoCars = "only Highway has other cars";
  static constexpr std::string_view kNoHumanoid = "the paper has no such error of the Humanoid";
  static constexpr MissingPreset kMissing[] = {
      {"gravity", "Highway", kNoModel},
      {"friction", "Highway", kNoModel},
      {"friction", "Hopper", "the paper changes the Hopper's gravity and leg"},
      {"leg", "", kNoLeg},
      {"cars", "", kNoCars},
      {"", "Humanoid", kNoHumanoid},
  };
  return kMissing;
}

const PerturbationEntry* FindEntry(std::string_view name) {
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (entry.name == name) return &entry;
  }
  return nullptr;
}

// "gravity=<factor>, friction=<factor>, ...": those that the environment takes.
std::string ParametricForms(std::string_view environment) {
  const Result<EnvironmentSpec> spec = DescribeEnvironment(environment);
  std::string forms;
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (spec.ok() && !Applies(entry, *spec)) continue;
    forms += fmt::format("{}{}=<{}>", forms.empty() ? "" : ", ", entry.name, entry.parameter);
  }
  return forms;
}

// The parametric form of a preset of any environment, or the form of that name; null if neither.
const PerturbationEntry* FindForm(std::string_view name) {
  for (const PerturbationPreset& preset : PresetList()) {
    if (preset.name == name) return FindEntry(preset.parametric);
  }
  return FindEntry(name);
}

// Why `name`, which is no preset of `environment` and no parametric form with an argument, is
// refused.
Status RefusePreset(std::string_view name, std::string_view environment) {
  const PerturbationEntry* form = FindForm(name);
  const Result<EnvironmentSpec> spec = DescribeEnvironment(environment);
  if (form == nullptr) {
    // "hidden=1,2": a comma ends the item before it.
    if (spec.ok() && spec->observation.FindDimensions(name).ok()) {
      return Status(StatusCode::kUnknownName,
                    fmt::format("unknown perturbation '{0}'; the dimensions of one perturbation "
                                "are joined by +: hidden=...+{0}",
                                name));
    }
    std::set<std::string_view> known;
    for (const PerturbationPreset& preset : PresetList()) known.insert(preset.name);
    for (const PerturbationEntry& entry : PerturbationList()) known.insert(entry.name);
    return UnknownName("perturbation", name, known);
  }
  std::string reason;
  for (const MissingPreset& missing : MissingPresets()) {
    const bool fits = (missing.name.empty() || missing.name == name) &&
                      (missing.environment.empty() || missing.environment == environment);
    if (fits && reason.empty()) reason = fmt::format(" ({})", missing.reason);
  }
  const std::string instead =
      spec.ok() && !Applies(*form, *spec)
          ? fmt::format("it takes {}", ParametricForms(environment))
          : fmt::format("give a value: {}=<{}>", form->name, form->parameter);
  return Status(StatusCode::kUnsupported,
                fmt::format("{} has no preset '{}'{}; {}", environment, name, reason, instead));
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
    return InvalidNumber("number of perturbations", static_cast<double>(items.size()),
                         fmt::format("at most {}", limits::kMaxPerturbations));
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
    if (!Applies(entry, spec)) {
      return Status(StatusCode::kUnsupported,
                    fmt::format("'{}' cannot be applied to {}; it takes {}", written.ToString(),
                                spec.name, ParametricForms(spec.name)));
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
