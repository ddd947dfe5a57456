#include "algorithms/datasets/import_name.h"

#include <fmt/format.h>

#include "algorithms/datasets/dataset_recipes.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

constexpr std::string_view kD4rlFolder = "d4rl/";

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

bool IsOfD4rl(std::string_view dataset) { return dataset.starts_with(kD4rlFolder); }

Result<std::string> EnvironmentOfImport(std::string_view dataset,
                                        const std::vector<std::string>& environments) {
  const bool is_d4rl = IsOfD4rl(dataset);
  const std::string_view rest = dataset.substr(is_d4rl ? kD4rlFolder.size() : 0);
  const std::string part(rest.substr(0, rest.find(is_d4rl ? '-' : '/')));
  std::vector<std::string> known;
  NearestName nearest(LowerCase(part));  // so that capital letters alone make no foreign name
  for (const std::string& environment : environments) {
    known.push_back(is_d4rl ? LowerCase(environment) : environment);
    if (known.back() == part) return environment;
    nearest.Consider(LowerCase(environment));
  }
  if (!nearest.nearest()) return std::string();
  return UnknownName("environment", part, known);
}

}  // namespace b4mrl
