// Which runs the words of `b4mrl benchmark` come to, given the data that can be had.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "tests/benchmarks/runner/suite.h"

namespace b4mrl {
namespace {

TEST_CASE("Runs on a dataset that cannot be made are left out, and the reason is said") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/action-delay/*";
  const Outcome some = Run(suite.Command({"--dry-run"}));
  INFO(some.err);
  CHECK(some.exit_code == 0);
  CHECK(some.out.find("HalfCheetah-bc-medium-s0") != std::string::npos);
  CHECK(some.out.find("2 runs: 0 done") != std::string::npos);
  CHECK(
      some.err.find("runs left out: 1, as HalfCheetah/action-delay-v0 cannot be made: no agent") !=
      std::string::npos);
  suite.pattern = "HalfCheetah/action-delay/gravity+*";
  const Outcome none = Run(suite.Command());
  CHECK(none.exit_code == 3);
  CHECK(none.err.find("HalfCheetah/action-delay-v0 cannot be made: no agent") != std::string::npos);
}

TEST_CASE("Runs on a dataset that its user made with an agent of their own are planned") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/action-delay/gravity+*";
  const std::string data = suite.Out() + "/data";
  std::filesystem::create_directories(data);
  REQUIRE(
      Run({"dataset", "make", "HalfCheetah/action-delay", "--agent",
           B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5", "--rows", "2000", "--data", data})
          .exit_code == 0);
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.out.find("1 of 1 runs done") != std::string::npos);
  CHECK(outcome.err.find("left out") == std::string::npos);
}

}  // namespace
}  // namespace b4mrl
