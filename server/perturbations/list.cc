#include "server/perturbations/list.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "proto/base/limits.h"

namespace b4mrl {

// One line for each perturbation: the name of the entry that its own file defines.
#define B4MRL_PERTURBATIONS(ENTRY) \
  ENTRY(kGravity)                  \
  ENTRY(kFriction)                 \
  ENTRY(kLegLength)                \
  ENTRY(kUsersModel)               \
  ENTRY(kCars)                     \
  ENTRY(kObservationNoise)         \
  ENTRY(kHiddenDimensions)         \
  ENTRY(kActionNoise)              \
  ENTRY(kActionDelay)

#define DECLARE(name) extern const PerturbationEntry name;
B4MRL_PERTURBATIONS(DECLARE)
#undef DECLARE

std::span<const PerturbationEntry> PerturbationList() {
#define NAME_WITH_COMMA(name) name,
  static const PerturbationEntry kList[] = {B4MRL_PERTURBATIONS(NAME_WITH_COMMA)};
#undef NAME_WITH_COMMA
  return kList;
}

const std::vector<Preset>& PresetList() {
  static const std::vector<Preset> presets = [] {
    std::vector<Preset> all;
    for (const PerturbationEntry& entry : PerturbationList()) {
      all.insert(all.end(), entry.presets.begin(), entry.presets.end());
    }
    for (const EnvironmentEntry& entry : EnvironmentList()) {
      all.insert(all.end(), entry.presets.begin(), entry.presets.end());
    }
    return all;
  }();
  return presets;
}

bool Applies(const PerturbationEntry& entry, const EnvironmentSpec& spec) {
  return entry.needs.empty() || std::ranges::count(spec.features, entry.needs) > 0;
}

namespace {

const PerturbationEntry* FindEntry(std::string_view name) {
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (entry.name == name) return &entry;
  }
  return nullptr;
}

// The preset's argument. An index in it counts the dimensions of the environment's default
// observation, and becomes their name: settings that add dimensions move the indices.
std::string ArgumentOf(const Preset& preset) {
  if (FindEntry(preset.parametric)->type == "dimensions") {
    const Result<EnvironmentSpec> spec = DescribeEnvironment(preset.environment);
    const Result<uint32_t> index = spec.ok() ? spec->observation.FindDimension(preset.argument)
                                             : Result<uint32_t>(spec.status());
    if (index.ok()) return spec->observation.dimensions[*index].name;
  }
  return std::string(preset.argument);
}

// The parametric forms that the environment takes: "gravity=<factor>, friction=<factor>, ...".
std::string ParametricForms(std::string_view environment, PerturbationUse use) {
  const Result<EnvironmentSpec> spec = DescribeEnvironment(environment);
  std::string forms;
  for (const PerturbationEntry& entry : PerturbationList()) {
    if (spec.ok() && !Applies(entry, *spec)) continue;
    if (use == PerturbationUse::kDataset && !entry.corrupts_datasets) continue;
    forms += fmt::format("{}{}=<{}>", forms.empty() ? "" : ", ", entry.name, entry.parameter);
  }
  return forms;
}

// The entry that preset `name` of any environment stands for, or the entry named so; else null.
const PerturbationEntry* FindForm(std::string_view name) {
  for (const Preset& preset : PresetList()) {
    if (preset.name == name) return FindEntry(preset.parametric);
  }
  return FindEntry(name);
}

// The error for `name`, which is neither a preset of `environment` nor a parametric form with an
// argument.
Status RefusePreset(std::string_view name, std::string_view environment) {
  const PerturbationEntry* form = FindForm(name);
  const Result<EnvironmentSpec> spec = DescribeEnvironment(environment);
  if (form == nullptr) {
    // In "hidden=1,2" the comma ends the item, and "2" arrives here as a name of its own.
    if (spec.ok() && spec->observation.FindDimensions(name).ok()) {
      return Status(StatusCode::kUnknownName,
                    fmt::format("unknown perturbation '{0}'; the dimensions of one perturbation "
                                "are joined by +: hidden=...+{0}",
                                name));
    }
    std::set<std::string_view> known;
    for (const Preset& preset : PresetList()) known.insert(preset.name);
    for (const PerturbationEntry& entry : PerturbationList()) known.insert(entry.name);
    return UnknownName("perturbation", name, known);
  }
  const bool lacks = spec.ok() && !Applies(*form, *spec);
  const std::string reason =
      lacks ? fmt::format("it does not have {}", form->needs) : "the paper gives none";
  const std::string instead =
      lacks ? fmt::format("it takes {}", ParametricForms(environment, PerturbationUse::kSimulator))
            : fmt::format("give a value: {}=<{}>", form->name, form->parameter);
  return Status(StatusCode::kUnsupported,
                fmt::format("{} has no preset '{}' ({}); {}", environment, name, reason, instead));
}

// Reads one end of a range, or a number.
Result<double> ParseEnd(const PerturbationEntry& entry, const std::string& what,
                        std::string_view text) {
  if (entry.type == "number") return ParseFinite(what, text, entry.low, entry.high);
  B4MRL_ASSIGN_OR_RETURN(const uint64_t value,
                         ParseUnsigned(what, text, static_cast<uint64_t>(entry.low),
                                       static_cast<uint64_t>(entry.high)));
  return static_cast<double>(value);
}

// Refuses a range beside another perturbation of its name: `info` has one entry a name, which is
// the drawn number.
Status CheckRangesAreAlone(const PerturbationSet& set) {
  const std::vector<NamedArgument> items = set.items();
  for (const std::string& name : set.parameter_names()) {
    const auto count = std::ranges::count(items, name, &NamedArgument::name);
    if (count == 1) continue;
    return InvalidNumber("number of " + name + " perturbations", static_cast<double>(count),
                         fmt::format("1 where {} is a range", name));
  }
  return Status();
}

}  // namespace

Result<NumberArgument> ParseNumber(const PerturbationInput& input) {
  const PerturbationEntry& entry = *input.entry;
  const std::string name(entry.name);
  NumberArgument number = {.whole = entry.type == "integer"};
  const size_t dots = entry.takes_range ? input.argument.find("..") : std::string_view::npos;
  if (dots == std::string_view::npos) {
    B4MRL_ASSIGN_OR_RETURN(number.low, ParseEnd(entry, name, input.argument));
    number.high = number.low;
    return number;
  }
  number.is_range = true;
  B4MRL_ASSIGN_OR_RETURN(number.low,
                         ParseEnd(entry, "lower end of " + name, input.argument.substr(0, dots)));
  B4MRL_ASSIGN_OR_RETURN(number.high,
                         ParseEnd(entry, "upper end of " + name, input.argument.substr(dots + 2)));
  if (number.low <= number.high) return number;
  return InvalidArgument(
      name, input.argument,
      fmt::format("LOW..HIGH with LOW <= HIGH, both in {}..{}", entry.low, entry.high));
}

Result<NamedArgument> ResolvePerturbation(const NamedArgument& item, std::string_view environment) {
  if (!item.argument.empty()) {
    if (FindEntry(item.name) != nullptr) return item;
    for (const Preset& preset : PresetList()) {
      if (preset.name != item.name) continue;
      return InvalidArgument(fmt::format("argument of preset '{}'", item.name), item.argument,
                             fmt::format("none, or {}={}", preset.parametric, item.argument));
    }
    return RefusePreset(item.name, environment);
  }
  for (const Preset& preset : PresetList()) {
    if (preset.name == item.name && preset.environment == environment) {
      return NamedArgument{std::string(preset.parametric), ArgumentOf(preset)};
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
          fmt::format("'{}' changes a simulator and cannot corrupt a dataset, which takes {}",
                      written.ToString(), ParametricForms(spec.name, use)));
    }
    if (!Applies(entry, spec)) {
      return Status(
          StatusCode::kUnsupported,
          fmt::format("'{}' cannot be applied to {}, which does not have {}; it takes {}",
                      written.ToString(), spec.name, entry.needs, ParametricForms(spec.name, use)));
    }
    const PerturbationInput input = {&entry, &spec, item.argument, occurrences[item.name]++};
    B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<Perturbation> member, entry.make(input));
    members.push_back(std::move(member));
  }
  // What is hidden stays hidden from noise, in whichever order they are written.
  std::ranges::stable_partition(members, [](const auto& member) {
    return member->ToNamedArgument().name != kHiddenDimensions.name;
  });
  PerturbationSet set(spec, std::move(members));
  B4MRL_RETURN_IF_ERROR(CheckRangesAreAlone(set));
  return set;
}

bool DrawsForDatasets(const PerturbationSet& set) {
  return std::ranges::any_of(set.members(), [](const auto& member) {
    return FindEntry(member->ToNamedArgument().name)->draws_for_datasets;
  });
}

Result<std::vector<uint32_t>> HiddenDimensions(std::span<const NamedArgument> items,
                                               const EnvironmentSpec& spec) {
  std::set<uint32_t> hidden;
  for (const NamedArgument& written : items) {
    B4MRL_ASSIGN_OR_RETURN(const NamedArgument item, ResolvePerturbation(written, spec.name));
    if (item.name != kHiddenDimensions.name) continue;
    B4MRL_ASSIGN_OR_RETURN(const std::vector<uint32_t> dimensions,
                           spec.observation.ParseDimensions(item.argument));
    hidden.insert(dimensions.begin(), dimensions.end());
  }
  return std::vector<uint32_t>(hidden.begin(), hidden.end());
}

}  // namespace b4mrl
