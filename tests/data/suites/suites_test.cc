// Suites are products of lists, and the project's own have the paper's benchmarks.
#include "data/suites/suites.h"

#include <algorithm>
#include <catch2/catch.hpp>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

const std::string kHead =
    "version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\nname = \"c\"\n";

std::vector<std::string> NamesOf(const std::vector<Benchmark>& benchmarks) {
  std::vector<std::string> names;
  for (const Benchmark& benchmark : benchmarks) names.push_back(benchmark.name);
  return names;
}

std::string Refusal(const std::string& text) {
  const auto parsed = ParseSuite(text, "mine.toml");
  REQUIRE_FALSE(parsed.ok());
  CHECK(parsed.status().message().find("mine.toml") != std::string::npos);
  CHECK(parsed.status().code() != StatusCode::kUnknownName);  // the user has named nothing
  return parsed.status().message();
}

TEST_CASE("A challenge is the product of its lists") {
  const auto made = Take(ParseSuite(
      kHead + "simulators = [\"gravity\"]\ncorruptions = [\"\", \"hidden=9\"]\n"
              "datasets = [\"medium\", \"random\"]\nworld = \"action-delay\"\n"
              "except = [\"hymopo\"]\nhyperparameters = { penalty = 0, discount = 0.9 }\n",
      "mine.toml"));
  CHECK(NamesOf(made) ==
        std::vector<std::string>{"Hopper/c/gravity+medium", "Hopper/c/gravity+random",
                                 "Hopper/c/hidden=9+medium", "Hopper/c/hidden=9+random"});
  const Benchmark& last = made.back();
  CHECK(last.suite == "v0");
  CHECK(last.environment == "Hopper");
  CHECK(last.challenge == "c");
  CHECK(last.simulator == "gravity");
  CHECK(last.corruption == "hidden=9");
  CHECK(last.dataset == "Hopper/random");
  CHECK(last.world == "action-delay");
  CHECK(last.hyperparameters == std::map<std::string, double>{{"penalty", 0}, {"discount", 0.9}});
  CHECK(last.DefinedFor("iql"));
  CHECK_FALSE(last.DefinedFor("hymopo"));
}

TEST_CASE("A label stands in names for the simulator") {
  const auto made = Take(ParseSuite(kHead + "label = \"true-simulator\"\nalgorithms = [\"sac\"]\n"
                                            "corruptions = [\"\", \"hidden-high\"]\n"
                                            "datasets = [\"medium\"]\n",
                                    "mine.toml"));
  CHECK(NamesOf(made) == std::vector<std::string>{"Hopper/c/true-simulator+medium",
                                                  "Hopper/c/true-simulator+hidden-high+medium"});
  CHECK(made[0].DefinedFor("sac"));
  CHECK_FALSE(made[0].DefinedFor("td3"));
}

TEST_CASE("Mistakes in a suite are refused by name") {
  CHECK(Refusal("version = ").find("line 1") != std::string::npos);
  CHECK(Refusal("environment = \"Hopper\"").find("'version'") != std::string::npos);
  CHECK(Refusal("version = \"v0\"\nenvironment = \"Hopper\"").find("[[challenge]]") !=
        std::string::npos);
  CHECK(Refusal(kHead + "dataset = [\"medium\"]").find("datasets") != std::string::npos);
  CHECK(Refusal(kHead + "datasets = \"medium\"").find("challenge 'c': 'datasets'") !=
        std::string::npos);
  CHECK(Refusal(kHead + "datasets = [\"../medium\"]").find("letters") != std::string::npos);
  CHECK(Refusal(kHead + "datasets = [1]").find("list of texts") != std::string::npos);
  CHECK(Refusal(kHead + "hyperparameters = { penalty = \"no\" }").find("numbers") !=
        std::string::npos);
  const std::string twice = Refusal(kHead +
                                    "datasets = [\"medium\"]\n[[challenge]]\nname = \"c\"\n"
                                    "datasets = [\"medium\"]\nworld = \"gravity\"\n");
  CHECK(twice.find("two benchmarks are named Hopper/c/medium") != std::string::npos);
  CHECK(twice.find("label") == std::string::npos);  // which would not help
  const std::string simulators =
      Refusal(kHead + "simulators = [\"gravity\", \"friction\"]\ncorruptions = [\"hidden=1\"]\n" +
              "datasets = [\"medium\"]\n");
  CHECK(simulators.ends_with("; give each simulator a [[challenge]] of its own with a `label`"));
  std::string many = kHead + "datasets = [";
  for (size_t i = 0; i <= kMaxBenchmarks; ++i) many += "\"d" + std::to_string(i) + "\", ";
  CHECK(Refusal(many + "]").find("more than 2048") != std::string::npos);
}

TEST_CASE("A user's folder adds benchmarks, and scores of any") {
  const TemporaryFolder mine;
  WriteBytes(mine.File("mine.toml"), kHead + "datasets = [\"medium\"]\n");
  WriteBytes(mine.File("paper.csv"), "benchmark,algorithm,mean,std\nHopper/c/medium,iql,40.5,1\n");
  const auto own = Take(ReadSuites({DefaultSuitesFolder()}));
  const auto all = Take(ReadSuites({DefaultSuitesFolder(), mine.path()}));
  REQUIRE(all.size() == own.size() + 1);
  CHECK(all.back().paper.at("iql").mean == 40.5);
  // The name of a benchmark with two perturbations holds a comma.
  const TemporaryFolder two;
  WriteBytes(two.File("two.toml"),
             kHead + "corruptions = [\"hidden=9,obs-noise=0.1\"]\ndatasets = [\"medium\"]\n");
  WriteBytes(two.File("paper.csv"),
             "benchmark,algorithm,mean,std\nHopper/c/hidden=9,obs-noise=0.1+medium,iql,30,1\n");
  CHECK(Take(ReadSuites({two.path()})).back().paper.at("iql").mean == 30);

  WriteBytes(mine.File("paper.csv"), "benchmark,algorithm,mean,std\nHopper/c/medium,iql,many,1\n");
  CHECK(ReadSuites({mine.path()}).status().message().find("line 2") != std::string::npos);
  WriteBytes(mine.File("again.toml"), kHead + "datasets = [\"medium\"]\n");
  CHECK_FALSE(ReadSuites({mine.path()}).ok());
  CHECK_FALSE(ReadSuites({mine.File("none")}).ok());
}

TEST_CASE("The project's suites have the paper's 52 benchmarks with all its scores") {
  const auto benchmarks = Take(ReadSuites({DefaultSuitesFolder()}));
  std::map<std::string, int> of_paper;  // by challenge
  size_t scores = 0;
  for (const Benchmark& benchmark : benchmarks) {
    if (benchmark.environment != "HalfCheetah" || benchmark.paper.size() < 7) continue;
    ++of_paper[benchmark.challenge];
    scores += benchmark.paper.size();
  }
  CHECK(of_paper == std::map<std::string, int>{{"modelling-error", 8},
                                               {"partial-observability-simulator", 16},
                                               {"partial-observability-dataset", 4},
                                               {"action-discrepancy", 8},
                                               {"confounding", 16}});
  CHECK(scores == 364);
  const auto found = std::ranges::find(
      benchmarks, "HalfCheetah/confounding/hidden-high+medium-expert", &Benchmark::name);
  REQUIRE(found != benchmarks.end());
  CHECK(found->simulator == "gravity");
  CHECK(found->dataset == "HalfCheetah/medium-expert");
  std::map<std::string, int> simulators;  // erroneous ones, by environment
  for (const Benchmark& benchmark : benchmarks) {
    if (benchmark.challenge == "simulators") ++simulators[benchmark.environment];
  }
  CHECK(simulators == std::map<std::string, int>{
                          {"HalfCheetah", 8}, {"Hopper", 8}, {"Walker2d", 8}, {"Highway", 7}});
}

}  // namespace
}  // namespace b4mrl
