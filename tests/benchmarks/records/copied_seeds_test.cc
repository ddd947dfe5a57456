// Seeds of a cell whose agents or curves are equal are named.
#include "benchmarks/records/copied_seeds.h"

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

Json ResultOf(uint64_t seed, const std::string& agent, double score) {
  return {{"cell", "c"}, {"seed", seed}, {"agent_sha256", agent}, {"curve", {{10, 0, score}}}};
}

// How many faults the second of two results has.
size_t FaultsOfSecond(const Json& first, const Json& second) {
  const auto faults = CopiedSeeds({first, second}, {"a.json", "b.json"});
  CHECK(faults[0].empty());
  return faults[1].size();
}

TEST_CASE("Two seeds share neither their agent nor their curve") {
  const Json first = ResultOf(0, "aa", 1);
  CHECK(FaultsOfSecond(first, ResultOf(1, "bb", 2)) == 0);
  CHECK(FaultsOfSecond(first, ResultOf(1, "aa", 2)) == 1);
  CHECK(FaultsOfSecond(first, ResultOf(1, "bb", 1)) == 1);
  CHECK(FaultsOfSecond(first, ResultOf(1, "aa", 1)) == 2);
  CHECK(CopiedSeeds({first, ResultOf(1, "aa", 2)}, {"a.json", "b.json"})[1] ==
        std::vector<std::string>{"its agent is that of seed 0 in a.json"});
}

TEST_CASE("The marks of results tell copies as the results do, and are small") {
  Json first = ResultOf(0, "aa", 1), copy = ResultOf(1, "aa", 1);
  for (Json* result : {&first, &copy}) (*result)["returns"] = std::vector<double>(10'000, 1.5);
  CHECK(FaultsOfSecond(SeedMarks(first), SeedMarks(copy)) == 2);
  CHECK(FaultsOfSecond(SeedMarks(first), SeedMarks(ResultOf(1, "bb", 2))) == 0);
  CHECK(FaultsOfSecond(SeedMarks(Json()), SeedMarks(Json())) == 0);
  CHECK(SeedMarks(first).dump().size() < 200);
}

TEST_CASE("One seed may be there twice, and cells may share an agent") {
  const Json first = ResultOf(0, "aa", 1);
  CHECK(FaultsOfSecond(first, first) == 0);  // with another precision, say
  Json elsewhere = ResultOf(1, "aa", 1);
  elsewhere["cell"] = "d";
  CHECK(FaultsOfSecond(first, elsewhere) == 0);
}

TEST_CASE("Results without an agent and a curve are no copies of each other") {
  CHECK(FaultsOfSecond({{"cell", "c"}, {"seed", 0}}, {{"cell", "c"}, {"seed", 1}}) == 0);
  CHECK(FaultsOfSecond(Json(), Json()) == 0);
}

}  // namespace
}  // namespace b4mrl
