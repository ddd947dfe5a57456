// The claims compare cells that there are.
#include <algorithm>
#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <vector>

#include "algorithms/list.h"
#include "benchmarks/plan/plan.h"
#include "data/files/toml_file.h"
#include "data/suites/suites.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

using Texts = std::vector<std::string>;

Texts TextsOf(const toml::table& table, std::string_view key) {
  Texts texts;
  const toml::array* array = table[key].as_array();
  for (size_t i = 0; array != nullptr && i < array->size(); ++i) {
    texts.push_back((*array)[i].value_or(std::string("no text")));
  }
  return texts;
}

// The benchmarks of one side, each {} replaced by each of `over`.
Texts BenchmarksOf(const toml::table& side, const Texts& over) {
  Texts names;
  for (const std::string& name : TextsOf(side, "benchmarks")) {
    const size_t hole = name.find("{}");
    if (hole == std::string::npos) names.push_back(name);
    for (size_t i = 0; hole != std::string::npos && i < over.size(); ++i) {
      names.push_back(std::string(name).replace(hole, 2, over[i]));
    }
  }
  return names;
}

TEST_CASE("Every claim compares benchmarks and algorithms that exist") {
  const auto benchmarks = Take(ReadSuites({DefaultSuitesFolder()}));
  const toml::table file = Take(ReadTomlFile(B4MRL_SOURCE_DIR "/benchmarks/claims.toml"));
  const toml::array* claims = file["claim"].as_array();
  REQUIRE(claims != nullptr);
  std::set<std::string> names;
  for (const toml::node& node : *claims) {
    const toml::table& claim = *node.as_table();
    const auto name = claim["name"].value_or(std::string());
    CAPTURE(name);
    CHECK(names.insert(name).second);
    CHECK(claim["line"].is_integer());
    const auto test = claim["test"].value_or(std::string());
    CHECK((test == "benchmarks" || test == "cells"));
    const auto pairs = claim["pairs"].value_or(std::string());
    CHECK((pairs.empty() || pairs == "same" || pairs == "best"));
    const toml::table* higher = claim["higher"].as_table();
    const toml::table* lower = claim["lower"].as_table();
    REQUIRE((higher != nullptr && lower != nullptr));
    CHECK_FALSE(TextsOf(*higher, "algorithms").empty());
    CHECK(TextsOf(*lower, "algorithms").empty() == (pairs == "same"));
    const Texts over = TextsOf(claim, "over");
    const Texts above = BenchmarksOf(*higher, over), below = BenchmarksOf(*lower, over);
    CHECK_FALSE(above.empty());
    CHECK((below.empty() || below.size() == above.size()));
    for (const Texts& side : {above, below}) {
      for (const std::string& pattern : side) {
        CAPTURE(pattern);
        CHECK(std::ranges::any_of(benchmarks, [&](const Benchmark& benchmark) {
          return FitsPattern(benchmark.name, pattern);
        }));
      }
    }
    for (const toml::table* side : {higher, lower}) {
      for (const std::string& algorithm : TextsOf(*side, "algorithms")) {
        CHECK(FindAlgorithm(algorithm).ok());
      }
    }
  }
  CHECK(names.size() == claims->size());
}

}  // namespace
}  // namespace b4mrl
