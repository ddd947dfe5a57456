#include "data/minari/minari_id.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("an exported dataset's id has its name, what its rows depend on, and its version") {
  CHECK(MinariIdOf({.name = "HalfCheetah/medium-v0"}) == "b4mrl/HalfCheetah/medium-v0");
  CHECK(MinariIdOf({.name = "d4rl/halfcheetah-medium-v2"}) == "b4mrl/d4rl/halfcheetah-medium-v2");
  CHECK(MinariIdOf({.name = "Hopper/mine"}) == "b4mrl/Hopper/mine-v0");
  CHECK(MinariIdOf({.name = "Hopper/medium-v12",
                    .corruptions = {{"obs-noise", "0.05"}, {"hidden", "9+16"}, {"flip", ""}},
                    .corruption_seed = 3,
                    .d4rl_transitions = true}) ==
        "b4mrl/Hopper/medium_obs-noise-0p05_hidden-9_16_flip_seed-3_d4rl-transitions-v12");
}

TEST_CASE("ids that Minari would not accept or list are refused") {
  for (const char* id : {"x-v0", "b4mrl/x-v0", "a/b_c/d-1-v10"}) {
    INFO(id);
    CHECK(CheckMinariId(id).ok());
  }
  for (const char* id :
       {"", "x", "-v0", "x-v", "x-vv", "a/-v0", "/x-v0", "a//x-v0", "a/x-v0/", "../x-v0",
        "a.b/x-v0", "data/x-v0", "a/data/x-v0", "x-v1234567890", "a\xc3\xa4/x-v0", "a b-v0"}) {
    INFO(id);
    CHECK(CheckMinariId(id).code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("the namespaces of an id are its folders, outer before inner") {
  CHECK(MinariNamespaces("x-v0").empty());
  CHECK(MinariNamespaces("a/b/x-v0") == std::vector<std::string>{"a", "a/b"});
}

}  // namespace
}  // namespace b4mrl
