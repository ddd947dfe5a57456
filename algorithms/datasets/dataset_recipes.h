// The datasets that `b4mrl dataset make` can make by name, and how: one line of a table each
// (dataset_recipes.cc).
//
// A recipe's name has a version, "HalfCheetah/medium-v0"; a name without one means the newest. A
// recipe is never changed once its data has been published (data/datasets.toml): another agent,
// rows or engine makes the next version. Immutable; any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace b4mrl {

enum class RecipeKind {
  kUniform,        // whole episodes of uniformly random actions
  kAgent,          // whole episodes of the agent's stochastic policy
  kReplay,         // the transitions of a training run, stepped again from its action log
  kConcatenation,  // the first half by one agent, the second half by another
};

struct DatasetRecipe {
  std::string_view name;  // "HalfCheetah/medium"
  uint32_t version = 0;   // 0 for "-v0"
  RecipeKind kind;
  std::string_view source;       // stem of a file of data/agents or, of a replay, of data/replays
  std::string_view second = "";  // of a concatenation, the agent of the second half
  std::string_view simulator = "";  // perturbations of the recorded world; "": the true one
  uint64_t rows = 1'000'000;
  uint64_t seed = 0;              // of a concatenation's first half; its second half has seed + 1
  std::string_view missing = "";  // why the dataset cannot be made; "" if it can

  std::string_view environment() const { return name.substr(0, name.find('/')); }
  std::string full_name() const;  // "HalfCheetah/medium-v0"
};

// All recipes, environment by environment.
std::span<const DatasetRecipe> DatasetRecipes();
// The recipe with that name, with or without a version; null if there is none.
const DatasetRecipe* FindRecipe(std::string_view name);
// A dataset's name without its version where that means the same recipe, else as it is. So equal
// data of recipes have one name, however they were asked for. Part of `name`.
std::string_view ShortName(std::string_view name);
// Whether both are versions of one dataset, and not the same, by names that ShortName gave.
bool AreVersionsOfOne(std::string_view one, std::string_view other);

}  // namespace b4mrl
