#include "algorithms/datasets/dataset_recipes.h"

#include <catch2/catch.hpp>
#include <set>
#include <string>

namespace b4mrl {
namespace {

TEST_CASE("A recipe is found by its full name, and the newest by the name alone") {
  std::set<std::string> names;
  for (const DatasetRecipe& recipe : DatasetRecipes()) {
    CAPTURE(recipe.full_name());
    CHECK(names.insert(recipe.full_name()).second);
    CHECK(FindRecipe(recipe.full_name()) == &recipe);
    const DatasetRecipe* newest = FindRecipe(recipe.name);
    REQUIRE(newest != nullptr);
    CHECK(newest->version >= recipe.version);
  }
  CHECK(FindRecipe("HalfCheetah/medium-v999") == nullptr);
  CHECK(FindRecipe("HalfCheetah/mine") == nullptr);
  CHECK(FindRecipe("") == nullptr);
}

TEST_CASE("A version is left off a name that means the same recipe without it, and off no other") {
  for (const DatasetRecipe& recipe : DatasetRecipes()) {
    const std::string full_name = recipe.full_name();
    const bool is_newest = FindRecipe(recipe.name) == &recipe;
    CHECK(ShortName(full_name) == (is_newest ? recipe.name : full_name));
    CHECK(ShortName(recipe.name) == recipe.name);
  }
  for (const char* name : {"HalfCheetah/medium-v999", "HalfCheetah/mine-v0",
                           "d4rl/halfcheetah-medium-v2", "d4rl/halfcheetah-medium-v0", ""}) {
    CHECK(ShortName(name) == name);
  }
}

}  // namespace
}  // namespace b4mrl
