#include "algorithms/datasets/import_name.h"

#include <fmt/format.h>

#include "algorithms/datasets/dataset_recipes.h"

namespace b4mrl {
namespace {

// "HalfCheetah/medium" of "HalfCheetah/medium-v7" and of itself.
std::string_view WithoutVersion(std::string_view dataset) {
  const size_t dash = dataset.rfind("-v");
  const bool has_version = dash != dataset.npos && dash + 2 < dataset.size() &&
                           dataset.find_first_not_of("0123456789", dash + 2) == dataset.npos;
  return has_version ? dataset.substr(0, dash) : dataset;
}

}  // namespace

Status CheckIsNoLevel(std::string_view dataset) {
  const DatasetRecipe* const recipe = FindRecipe(WithoutVersion(dataset));
  // A recipe that cannot be followed has no published dataset that could be mistaken.
  if (recipe == nullptr || !recipe->missing.empty()) return Status();
  return InvalidArgument(
      "dataset", dataset,
      fmt::format("names other than {0} and its versions, which `b4mrl dataset make` makes, as "
                  "{0}-mine",
                  recipe->name));
}

}  // namespace b4mrl
