#include "benchmarks/evidence/other_rows.h"

#include <catch2/catch.hpp>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

TEST_CASE("Runs on other rows than the published ones are counted, and the fewest rows named") {
  const std::string& name = OwnBenchmarks().front().name;
  const auto made = [&](const std::string& algorithm, const std::string& rows) {
    return MadeResult{.algorithm = algorithm, .benchmarks = {name}, .score = 1, .rows = rows};
  };
  const MadeResults results({made("iql", "published"), made("bc", "a tenth"), made("mopo", "x")});
  const ScoreTable table = results.Read(OwnBenchmarks());
  PublishedDataset medium;
  medium.rows = 1'000'000;
  medium.columns_sha256 = "published";
  const auto others = RunsOnOtherRows(table, {{"HalfCheetah/medium-v0", medium}});
  REQUIRE(others);
  CHECK(others->runs == 2);
  CHECK(others->dataset == "HalfCheetah/medium-v0");
  CHECK(others->rows == 1'000);  // as made results say
  CHECK(others->published == 1'000'000);
  CHECK_FALSE(RunsOnOtherRows(table, {}));  // of a user's own nothing is published
  medium.columns_sha256 = "a tenth";
  CHECK(RunsOnOtherRows(table, {{"HalfCheetah/medium-v0", medium}})->runs == 2);
}

}  // namespace
}  // namespace b4mrl
