// b4mrl list prints the catalogue.
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/datasets/dataset_recipes.h"
#include "tests/algorithms/tools/tool.h"

namespace b4mrl {
namespace {

TEST_CASE("Lists are JSON arrays of objects with a name") {
  for (Words words : std::vector<Words>{
           {"environments"}, {"dimensions", "HalfCheetah"}, {"perturbations"}, {"algorithms"}}) {
    words.insert(words.begin(), "list");
    words.push_back("--json");
    const Outcome outcome = Run(words);
    INFO(words[1] << ": " << outcome.err);
    CHECK(outcome.exit_code == 0);
    const auto json = nlohmann::json::parse(outcome.out, nullptr, false);
    REQUIRE(json.is_array());
    CHECK_FALSE(json.empty());
    for (const auto& item : json) CHECK(item["name"].is_string());
  }
}

TEST_CASE("A list that there is not is refused with the names of those that there are") {
  const Outcome outcome = Run({"list", "benchmark"});
  CHECK(outcome.exit_code == 2);
  CHECK(outcome.out.empty());
  CHECK(outcome.err.find("did you mean 'benchmarks'") != std::string::npos);
  CHECK(outcome.err.find("environments") != std::string::npos);
  CHECK(Run({"list", "perturbations", "HalfCheetah"}).exit_code == 2);  // takes no environment
}

TEST_CASE("The list of benchmarks has those of the user's own suites") {
  const TemporaryFolder suites;
  WriteBytes(suites.File("mine.toml"),
             "version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\nname = \"mine\"\n"
             "simulators = [\"gravity\"]\n");
  const Outcome outcome = Run({"list", "benchmarks", "--suites", suites.path()});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 0);
  CHECK(outcome.out.find("Hopper/mine/gravity ") != std::string::npos);
  const Outcome other = Run({"list", "datasets", "--suites", suites.path()});
  CHECK(other.exit_code == 2);
  CHECK(other.err.find("`list benchmarks` alone") != std::string::npos);
  const Outcome missing = Run({"list", "benchmarks", "--suites", suites.File("none")});
  CHECK(missing.exit_code != 0);
  CHECK(missing.err.find("cannot use --suites") != std::string::npos);
}

TEST_CASE("The list of benchmarks spells out what each is made of, from data that can be made") {
  const Outcome outcome = Run({"list", "benchmarks", "--json"});
  REQUIRE(outcome.exit_code == 0);
  const auto benchmarks = nlohmann::json::parse(outcome.out, nullptr, false);
  size_t of_paper = 0;
  for (const nlohmann::json& benchmark : benchmarks) {
    CAPTURE(benchmark["name"].get<std::string>());
    for (const char* key : {"environment", "simulator", "dataset", "corruption", "world"}) {
      CHECK(benchmark[key].is_string());
    }
    CHECK_FALSE(benchmark["algorithms"].empty());
    of_paper += benchmark["paper"].size() == 7 ? 1 : 0;
    const auto dataset = benchmark["dataset"].get<std::string>();
    CHECK((dataset.empty() || FindRecipe(dataset) != nullptr));
  }
  CHECK(of_paper == 52);
}

}  // namespace
}  // namespace b4mrl
