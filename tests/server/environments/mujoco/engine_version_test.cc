#include "server/environments/mujoco/engine_version.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

TEST_CASE("The loaded engine is that of the recordings and of the headers") {
  CHECK(EngineVersion() == "MuJoCo 2.2.2");
  CHECK(CheckEngineVersion().ToString() == Status().ToString());
}

}  // namespace
}  // namespace b4mrl
