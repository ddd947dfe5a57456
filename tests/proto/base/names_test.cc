#include "proto/base/names.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("A version is -v and digits at the end of a name") {
  CHECK(VersionOf("HalfCheetah/medium-v0") == "-v0");
  CHECK(WithoutVersion("HalfCheetah/medium-v0") == "HalfCheetah/medium");
  CHECK(WithoutVersion("halfcheetah-medium-v2-v10") == "halfcheetah-medium-v2");
  for (const char* name :
       {"HalfCheetah/medium", "mine/a-very", "mine/a-v", "mine/a-v0-b", "-v", ""}) {
    CHECK(VersionOf(name).empty());
    CHECK(WithoutVersion(name) == name);
  }
}

}  // namespace
}  // namespace b4mrl
