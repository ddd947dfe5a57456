// Which learning curves share a panel.
#include <catch2/catch.hpp>

#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/report.h"
#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kMedium[] = "HalfCheetah/modelling-error/gravity+medium";
constexpr char kExpert[] = "HalfCheetah/modelling-error/gravity+medium-expert";

// A result that was evaluated after each of so many thousand updates.
std::string LongerResult(const MadeResult& made, int thousands) {
  nlohmann::ordered_json json = JsonOf(made);
  json["updates"] = 1000 * thousands;
  json["dataset"] = nullptr;
  json["curve"] = nlohmann::ordered_json::array();
  for (int i = 1; i <= thousands; ++i) {
    json["curve"].push_back({1000 * i, 0, made.score * 100, 5.0, made.score});
  }
  return json.dump();
}

std::vector<Panel> PanelsOf(const MadeResults& results) {
  const Evidence evidence = Take(GatherEvidence({.folder = results.path()}));
  std::vector<Panel> panels;
  for (const Picture& picture : CurvesPictures(evidence)) {
    panels.insert(panels.end(), picture.figure.panels.begin(), picture.figure.panels.end());
  }
  return panels;
}

size_t LinesOf(const Panel& panel, bool dashed) {
  size_t count = 0;
  for (const Mark& mark : panel.marks) {
    const Line* line = std::get_if<Line>(&mark);
    count += line != nullptr && line->dashed == dashed;
  }
  return count;
}

TEST_CASE("Returns of a task without scores have an axis of their own") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kMedium}, .score = 40}});
  nlohmann::ordered_json json =
      JsonOf({.algorithm = "iql", .benchmarks = {kExpert}, .score = 50, .cell = "other"});
  for (auto& point : json["curve"]) point[4] = nullptr;
  results.Add(json.dump());
  const std::vector<Panel> panels = PanelsOf(results);
  REQUIRE(panels.size() == 2);
  CHECK(panels[0].y.name == "score");
  CHECK(panels[0].y.high < 100);
  CHECK(panels[1].y.name == "return");
  CHECK(panels[1].y.high >= 5000);
}

TEST_CASE("Much longer runs have a panel of their own, once, and end as a dashed line elsewhere") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kMedium}, .score = 40},
                       {.algorithm = "iql", .benchmarks = {kExpert}, .score = 50}});
  results.Add(
      LongerResult({.algorithm = "sac", .benchmarks = {kMedium, kExpert}, .score = 35}, 10));
  const std::vector<Panel> panels = PanelsOf(results);
  REQUIRE(panels.size() == 3);
  CHECK(panels[0].title == kMedium);
  CHECK(LinesOf(panels[0], false) == 1);
  REQUIRE(LinesOf(panels[0], true) == 1);
  CHECK(std::get<Line>(panels[0].marks[0]).y == std::vector<double>{35, 35});
  CHECK(std::get<Line>(panels[0].marks[0]).x == std::vector<double>{0, 1});
  CHECK(panels[0].x.high < 2);
  CHECK(panels[1].title == "HalfCheetah, gravity simulator, without data");
  CHECK(LinesOf(panels[1], false) == 1);
  CHECK(LinesOf(panels[1], true) == 0);
  CHECK(panels[1].x.high >= 10);
  CHECK(panels[2].title == kExpert);
}

TEST_CASE("The title of curves without data tells their world and a true simulator") {
  constexpr char kDelayed[] = "HalfCheetah/action-delay/gravity+action-delay";
  constexpr char kClean[] = "HalfCheetah/clean/medium";
  MadeResults results({});
  results.Add(LongerResult({.algorithm = "sac", .benchmarks = {kClean}, .score = 80}, 4));
  results.Add(LongerResult({.algorithm = "sac", .benchmarks = {kDelayed}, .score = 35}, 4));
  std::vector<std::string> titles;
  for (const Panel& panel : PanelsOf(results)) titles.push_back(panel.title);
  CHECK(titles ==
        std::vector<std::string>{"HalfCheetah, true simulator, without data",
                                 "HalfCheetah, in action-delay, gravity simulator, without data"});
}

TEST_CASE("Runs of similar lengths share a panel") {
  MadeResults results({{.algorithm = "iql", .benchmarks = {kMedium}, .score = 40}});
  results.Add(LongerResult({.algorithm = "sac", .benchmarks = {kMedium}, .score = 35}, 4));
  const std::vector<Panel> panels = PanelsOf(results);
  REQUIRE(panels.size() == 1);
  CHECK(LinesOf(panels[0], false) == 2);
  CHECK(LinesOf(panels[0], true) == 0);
}

}  // namespace
}  // namespace b4mrl
