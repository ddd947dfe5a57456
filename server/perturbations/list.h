// The table of perturbations, the paper's presets, and how their text becomes objects. Adding one
// is a .cc file, a line in list.cc, and its presets' lines. No physics engine is needed to build a
// set. Any thread.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/perturbations/perturbation.h"

namespace b4mrl {

// What a set is built for.
enum class PerturbationUse { kSimulator, kDataset };

struct PerturbationInput {
  const EnvironmentSpec* spec = nullptr;
  std::string_view argument;  // as written after '='; never empty
  uint64_t occurrence = 0;    // how many of the same name stand before it
};

struct PerturbationEntry {
  std::string_view name;       // of the parametric form: "gravity"
  std::string_view parameter;  // "factor", "dimensions"
  std::string_view type;       // "number", "integer", "dimensions" or "file"
  double low = 0;              // of a number
  double high = 0;
  std::string_view description;  // one line
  bool corrupts_datasets = false;
  // Whether an environment can be perturbed so; null: any can.
  bool (*applies)(const EnvironmentSpec& spec) = nullptr;
  Result<std::unique_ptr<Perturbation>> (*make)(const PerturbationInput& input);
};

struct PerturbationPreset {
  std::string_view name;         // "obs-noise-low"; "gravity" without an argument is a preset too
  std::string_view environment;  // "HalfCheetah"
  std::string_view parametric;   // the name of the parametric form: "obs-noise"
  std::string_view argument;     // "0.01"
};

// A preset that an environment does not have, and why. "" stands for every preset or environment.
struct MissingPreset {
  std::string_view name;
  std::string_view environment;
  std::string_view reason;
};

std::span<const PerturbationEntry> PerturbationList();
bool Applies(const PerturbationEntry& entry, const EnvironmentSpec& spec);
// For PerturbationEntry::applies: environments on a compiled MuJoCo model.
bool HasModel(const EnvironmentSpec& spec);
// What model=FILE.xml accepts: a plain name without folders.
bool IsModelFileName(std::string_view name);
std::span<const PerturbationPreset> PresetList();

// A preset becomes its parametric form; a parametric form stays. Unknown names and missing presets
// are kUnknownName and kUnsupported with the nearest name or the reason.
Result<NamedArgument> ResolvePerturbation(const NamedArgument& item, std::string_view environment);

// Builds all of `items` in order for an environment or dataset with `spec`. Refuses more than
// limits::kMaxPerturbations, arguments out of bounds, unknown dimensions, what cannot be applied to
// the environment and, for datasets, whatever changes a simulator rather than data.
Result<PerturbationSet> MakePerturbations(std::span<const NamedArgument> items,
                                          const EnvironmentSpec& spec, PerturbationUse use);

// The 0-based dimensions that `items` (resolved) hide; sorted, without repetition.
Result<std::vector<uint32_t>> HiddenDimensions(std::span<const NamedArgument> items,
                                               const EnvironmentSpec& spec);

}  // namespace b4mrl
