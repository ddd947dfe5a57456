// Suites are checked for what their file's reader cannot know: environments and perturbations.
#include "server/gateway/suite_check.h"

#include <catch2/catch.hpp>
#include <string>

#include "tests/results.h"

namespace b4mrl {
namespace {

TEST_CASE("The project's own suites can be had") {
  RequireOk(CheckSuites(Take(ReadSuites({DefaultSuitesFolder()}))));
}

// What is said of a suite with one challenge for Hopper.
std::string SaidOf(const std::string& keys) {
  const auto benchmarks =
      Take(ParseSuite("version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\n"
                      "name = \"mine\"\n" +
                          keys,
                      "mine.toml"));
  return CheckSuites(benchmarks).message();
}

TEST_CASE("Perturbations that are misspelt, impossible or out of bounds are named") {
  CHECK(SaidOf("simulators = [\"leg=0.9\"]\ncorruptions = [\"\", \"hidden=3\"]\n") == "");
  CHECK_THAT(SaidOf("simulators = [\"gravity\", \"legg=0.9\"]\n"),
             Catch::StartsWith("benchmark Hopper/mine/legg=0.9, simulators: ") &&
                 Catch::Contains("did you mean 'leg'"));
  CHECK_THAT(SaidOf("corruptions = [\"obs-nois=0.1\"]\ndatasets = [\"random\"]\n"),
             Catch::StartsWith("benchmark Hopper/mine/obs-nois=0.1+random, corruptions: ") &&
                 Catch::Contains("did you mean 'obs-noise'"));
  CHECK_THAT(SaidOf("world = \"legg\"\n"), Catch::Contains("world: unknown perturbation 'legg'"));
  CHECK_THAT(SaidOf("simulators = [\"cars=3\"]\n"),
             Catch::Contains("cannot be applied to Hopper, which does not have other cars"));
  CHECK_THAT(SaidOf("corruptions = [\"gravity=2\"]\n"),
             Catch::Contains("cannot corrupt a dataset, which takes obs-noise=") &&
                 !Catch::Contains("friction="));
  CHECK_THAT(SaidOf("simulators = [\"gravity=1000\"]\n"), Catch::Contains("-10..10"));
}

TEST_CASE("An environment that there is not is named with the nearest one") {
  Benchmark benchmark;
  benchmark.name = "Hoper/mine/a";
  benchmark.environment = "Hoper";
  const Status status = CheckSuites({benchmark});
  CHECK(status.code() == StatusCode::kUnknownName);
  CHECK_THAT(status.message(), Catch::StartsWith("benchmark Hoper/mine/a: ") &&
                                   Catch::Contains("did you mean 'Hopper'"));
}

}  // namespace
}  // namespace b4mrl
