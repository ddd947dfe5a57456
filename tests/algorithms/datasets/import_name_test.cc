#include "algorithms/datasets/import_name.h"

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "algorithms/datasets/published_datasets.h"

namespace b4mrl {
namespace {

TEST_CASE("No import has the name of a published dataset, whatever its version") {
  const auto published = ReadPublishedDatasets(B4MRL_SOURCE_DIR "/data/datasets.toml");
  REQUIRE(published.ok());
  REQUIRE_FALSE(published->empty());
  for (const auto& [full_name, dataset] : *published) {
    const std::string level = full_name.substr(0, full_name.rfind("-v"));
    for (const std::string& name : {level, full_name, level + "-v7", level + "-v12"}) {
      CAPTURE(name);
      const Status refused = CheckIsNoLevel(name);
      CHECK(refused.code() == StatusCode::kInvalidArgument);
      CHECK_THAT(refused.message(), Catch::Contains("'" + name + "'") &&
                                        Catch::Contains("`b4mrl dataset make` makes") &&
                                        Catch::Contains(level + "-mine"));
    }
  }
  for (const char* name : {"HalfCheetah/mine", "HalfCheetah/mine-v0", "HalfCheetah/medium-mine",
                           "HalfCheetah/medium-v", "HalfCheetah/medium-v0-mine", "Hopper/partial",
                           "d4rl/halfcheetah-medium-v2", "medium", ""}) {
    CAPTURE(name);
    CHECK(CheckIsNoLevel(name).ok());
  }
}

TEST_CASE("An import's name tells its environment, or none if it resembles none") {
  const std::vector<std::string> known = {"HalfCheetah", "Hopper", "Walker2d", "Humanoid"};
  CHECK(*EnvironmentOfImport("HalfCheetah/mine", known) == "HalfCheetah");
  CHECK(*EnvironmentOfImport("d4rl/walker2d-medium-v2", known) == "Walker2d");
  for (const char* name : {"Ant/medium", "mine/HalfCheetah", "zz/y", "d4rl/maze2d-umaze-v1", ""}) {
    CAPTURE(name);
    CHECK(*EnvironmentOfImport(name, known) == "");
  }
  for (const char* name : {"halfcheetah/mine", "HALFCHEETAH/mine", "HalfChetah/mine", "hopper/mine",
                           "Walker/mine", "d4rl/HalfCheetah-medium-v2", "d4rl/walker-medium-v2"}) {
    CAPTURE(name);
    CHECK(EnvironmentOfImport(name, known).status().code() == StatusCode::kUnknownName);
  }
  CHECK_THAT(EnvironmentOfImport("halfcheetah/mine", known).status().message(),
             Catch::StartsWith("unknown environment 'halfcheetah'; did you mean 'HalfCheetah'?"));
}

}  // namespace
}  // namespace b4mrl
