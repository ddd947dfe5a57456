#include "benchmarks/evidence/hybrid_gain.h"

#include <algorithm>
#include <catch2/catch.hpp>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

TEST_CASE("In the paper HyMOPO gains in 17 of 52 benchmarks and H2O in 1") {
  const auto gains = HybridGains(PaperScores(OwnBenchmarks()), OwnBenchmarks());
  const auto above = [&](const char* algorithm) {
    return std::ranges::count_if(gains, [&](const HybridGain& gain) {
      return gain.algorithm == algorithm && gain.gain > 0;
    });
  };
  CHECK(gains.size() == 104);
  CHECK(std::ranges::all_of(gains, &HybridGain::has_papers));
  CHECK(above("hymopo") == 17);
  CHECK(above("h2o") == 1);
}

TEST_CASE("A gain is taken from the best single source and rests on settled scores alone") {
  const std::string benchmark = "HalfCheetah/modelling-error/gravity+medium";
  CellScores scores;
  scores[{benchmark, "sac"}].mean = 40;
  scores[{benchmark, "iql"}].mean = 50;
  scores[{benchmark, "hymopo"}].mean = 55;
  scores[{benchmark, "mine"}].mean = 60;
  auto gains = HybridGains(scores, OwnBenchmarks());
  REQUIRE(gains.size() == 2);
  CHECK(gains[0].algorithm == "hymopo");
  CHECK(gains[0].gain == 5);
  CHECK(gains[0].best == "iql");
  CHECK(gains[0].compared == 2);
  CHECK_FALSE(gains[0].has_papers);
  CHECK(gains[0].settled);
  CHECK(gains[1].algorithm == "mine");
  CHECK(gains[1].gain == 10);
  scores[{benchmark, "mine"}].has_one_source = true;
  CHECK(HybridGains(scores, OwnBenchmarks()).size() == 1);
  scores[{benchmark, "sac"}].settled = false;
  gains = HybridGains(scores, OwnBenchmarks());
  CHECK_FALSE(gains[0].settled);
}

}  // namespace
}  // namespace b4mrl
