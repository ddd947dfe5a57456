#include "algorithms/datasets/dataset_recipes.h"

#include <fmt/format.h>

#include "proto/base/names.h"

namespace b4mrl {
namespace {

constexpr auto kUniform = RecipeKind::kUniform;
constexpr auto kAgent = RecipeKind::kAgent;
constexpr auto kReplay = RecipeKind::kReplay;
constexpr auto kConcatenation = RecipeKind::kConcatenation;

// Seeds differ between the levels of an environment, so that their episodes start differently, but
// for expert and late-expert; a concatenation begins with the rows of medium and goes on with those
// of an expert.
constexpr DatasetRecipe kRecipes[] = {
    {"HalfCheetah/random", 0, kUniform, "", "", "", 1'000'000, 2},
    {"HalfCheetah/medium", 0, kAgent, "halfcheetah-medium"},
    {"HalfCheetah/medium-replay", 0, kReplay, "halfcheetah-medium", "", "", 110'000, 1},
    {"HalfCheetah/expert", 0, kAgent, "halfcheetah-expert", "", "", 1'000'000, 1},
    {"HalfCheetah/medium-expert", 0, kConcatenation, "halfcheetah-medium", "halfcheetah-expert", "",
     2'000'000},
    {"HalfCheetah/late-expert", 0, kAgent, "halfcheetah-late-expert", "", "", 1'000'000, 1},
    {"HalfCheetah/medium-late-expert", 0, kConcatenation, "halfcheetah-medium",
     "halfcheetah-late-expert", "", 2'000'000},
    {"HalfCheetah/partial-low", 0, kAgent, "halfcheetah-partial-low", "", "hidden-low", 1'000'000,
     3},
    {"HalfCheetah/partial-low-history", 0, kAgent, "halfcheetah-partial-low-history", "",
     "hidden-low", 1'000'000, 4},
    {"HalfCheetah/partial-high", 0, kAgent, "halfcheetah-partial-high", "", "hidden-high",
     1'000'000, 5},
    {"HalfCheetah/partial-high-history", 0, kAgent, "halfcheetah-partial-high-history", "",
     "hidden-high", 1'000'000, 6},
    {"HalfCheetah/action-delay", 0, kAgent, "halfcheetah-action-delay", "", "action-delay",
     1'000'000, 7,
     "no agent has reached the medium level in the delayed world: SAC scored 0.4 there after "
     "120,000 updates"},
    {"Hopper/random", 0, kUniform, "", "", "", 1'000'000, 2},
    {"Hopper/medium", 0, kAgent, "hopper-medium"},
    {"Hopper/medium-replay", 0, kReplay, "hopper-medium", "", "", 125'000},
    {"Hopper/expert", 0, kAgent, "hopper-expert", "", "", 1'000'000, 1},
    {"Hopper/medium-expert", 0, kConcatenation, "hopper-medium", "hopper-expert", "", 2'000'000},
    {"Walker2d/random", 0, kUniform, "", "", "", 1'000'000, 2},
    {"Walker2d/medium", 0, kAgent, "walker2d-medium"},
    {"Walker2d/medium-replay", 0, kReplay, "walker2d-medium", "", "", 260'000},
    {"Walker2d/expert", 0, kAgent, "walker2d-expert", "", "", 1'000'000, 1},
    {"Walker2d/medium-expert", 0, kConcatenation, "walker2d-medium", "walker2d-expert", "",
     2'000'000},
    {"Highway/random", 0, kUniform, "", "", "", 1'000'000, 2},
    {"Highway/medium", 0, kAgent, "highway-medium"},
};

}  // namespace

std::string DatasetRecipe::full_name() const { return fmt::format("{}-v{}", name, version); }

std::span<const DatasetRecipe> DatasetRecipes() { return kRecipes; }

const DatasetRecipe* FindRecipe(std::string_view name) {
  const DatasetRecipe* newest = nullptr;
  for (const DatasetRecipe& recipe : kRecipes) {
    if (recipe.full_name() == name) return &recipe;
    if (recipe.name == name && (!newest || recipe.version > newest->version)) newest = &recipe;
  }
  return newest;
}

std::string_view ShortName(std::string_view name) {
  const std::string_view plain = WithoutVersion(name);
  const DatasetRecipe* newest = FindRecipe(plain);
  return newest != nullptr && newest->full_name() == name ? plain : name;
}

bool AreVersionsOfOne(std::string_view one, std::string_view other) {
  return one != other && WithoutVersion(one) == WithoutVersion(other);
}

}  // namespace b4mrl
