// The table of perturbations and their presets, and how their text becomes objects. Adding a
// perturbation takes a .cc file and a line in list.cc. No physics engine is needed to build a set.
// Any thread.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/environments/list.h"
#include "server/perturbations/perturbation.h"

namespace b4mrl {

// What a PerturbationSet is built for.
enum class PerturbationUse { kSimulator, kDataset };

struct PerturbationEntry;

struct PerturbationInput {
  const PerturbationEntry* entry = nullptr;
  const EnvironmentSpec* spec = nullptr;
  std::string_view argument;  // as written after '='; never empty
  uint64_t occurrence = 0;    // number of perturbations of this name before it
};

struct PerturbationEntry {
  std::string_view name;       // of the parametric form: "gravity"
  std::string_view parameter;  // "factor", "dimensions"
  std::string_view type;       // "number", "integer", "dimensions" or "file"
  double low = 0;              // least and greatest value of a number or integer
  double high = 0;
  bool takes_range = false;      // accepts LOW..HIGH, drawn anew for each episode
  std::string_view description;  // one line
  bool corrupts_datasets = false;
  bool draws_for_datasets = false;  // whether its effect on a dataset is random
  // What the environment must have: one of EnvironmentSpec::features; "" for nothing.
  std::string_view needs;
  std::span<const Preset> presets;  // for all environments: the paper's values
  Result<std::unique_ptr<Perturbation>> (*make)(const PerturbationInput& input);
};

// The argument as a number, or as a range where the entry takes one. kInvalidArgument, with the
// allowed values, where it is neither, exceeds the entry's bounds, or is a range with LOW above
// HIGH.
Result<NumberArgument> ParseNumber(const PerturbationInput& input);

// Base class of perturbations whose argument is a number or, if the entry says so, a range.
class NumberPerturbation : public Perturbation {
 public:
  NumberPerturbation(const PerturbationInput& input, const NumberArgument& number)
      : name_(input.entry->name), occurrence_(input.occurrence), number_(number) {}
  NamedArgument ToNamedArgument() const final { return {name_, number_.ToString()}; }
  const NumberArgument* number() const final { return &number_; }

 protected:
  // The argument of a perturbation that takes no range. OnOptions and OnModel, where a range may
  // come, get the drawn number as an argument instead.
  double fixed_number() const { return number_.low; }
  // The generator of this perturbation's random numbers of one row, which draws `per_row` of them.
  Rng RowRng(const DrawContext& context, uint64_t per_row) const {
    return b4mrl::RowRng(context, name_, occurrence_, per_row);
  }

 private:
  std::string name_;
  uint64_t occurrence_;
  NumberArgument number_;
};

// PerturbationEntry::make of a NumberPerturbation.
template <typename Kind>
Result<std::unique_ptr<Perturbation>> MakeNumberPerturbation(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const NumberArgument number, ParseNumber(input));
  return std::unique_ptr<Perturbation>(std::make_unique<Kind>(input, number));
}

std::span<const PerturbationEntry> PerturbationList();
bool Applies(const PerturbationEntry& entry, const EnvironmentSpec& spec);
// Whether model=FILE.xml accepts this file name: a plain name without folders.
bool IsModelFileName(std::string_view name);
// The presets of all perturbations and environments.
const std::vector<Preset>& PresetList();

// A preset becomes its parametric form; a parametric form stays. Unknown names and missing presets
// are kUnknownName and kUnsupported with the nearest name or the reason.
Result<NamedArgument> ResolvePerturbation(const NamedArgument& item, std::string_view environment);

// Builds all of `items` in order for an environment or dataset with `spec`. Refuses more than
// limits::kMaxPerturbations, arguments out of bounds, unknown dimensions, a name with a range
// beside the same name, what cannot be applied to the environment and, for datasets, whatever
// changes a simulator rather than data.
Result<PerturbationSet> MakePerturbations(std::span<const NamedArgument> items,
                                          const EnvironmentSpec& spec, PerturbationUse use);

// Whether corrupting a dataset by `set` draws random numbers, so that the seed matters.
bool DrawsForDatasets(const PerturbationSet& set);

// The 0-based dimensions that `items` hide; sorted, without repetition.
Result<std::vector<uint32_t>> HiddenDimensions(std::span<const NamedArgument> items,
                                               const EnvironmentSpec& spec);

}  // namespace b4mrl
