// `b4mrl dataset info --svg` draws what the daemon serves.
#include <catch2/catch.hpp>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/algorithms/pictures/svg_document.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/example_dataset.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// Three episodes of HalfCheetah's sizes with a NaN in observation 3.
void WriteSpoiltDataset(const TemporaryFolder& folder) {
  REQUIRE(std::filesystem::create_directories(folder.File("data/HalfCheetah")));
  ExampleDataset data = MakeExampleDataset({300, 200, 100}, 17, 6);
  data.observations[17 * 450 + 3] = std::numeric_limits<float>::quiet_NaN();
  RequireOk(WriteExample(folder.File("data/HalfCheetah/odd.h5"), data));
}

Outcome Draw(const TemporaryFolder& folder, const std::string& pictures, const Words& more = {}) {
  Words words = {
      "dataset",           "info",   "HalfCheetah/odd", "--svg", folder.File(pictures), "--data",
      folder.File("data"), "--quiet"};
  words.insert(words.end(), more.begin(), more.end());
  return Run(words);
}

TEST_CASE("Pictures of a dataset are drawn beside its description, with equal bytes each time") {
  const TemporaryFolder folder;
  WriteSpoiltDataset(folder);
  const Words corrupted = {"--corruption", "hidden=9", "--json"};
  const Outcome drawn = Draw(folder, "new/pictures", corrupted);
  INFO(drawn.err);
  REQUIRE(drawn.exit_code == 0);
  const auto json = nlohmann::json::parse(drawn.out, nullptr, false);
  CHECK(json["rows"] == 600);
  CHECK(json["nonfinite_rows"] == 1);
  CHECK(json["corruption"] == "hidden=9");
  CHECK(json["pictures"] == nlohmann::json{folder.File("new/pictures/returns.svg"),
                                           folder.File("new/pictures/observations.svg"),
                                           folder.File("new/pictures/actions.svg")});
  REQUIRE(Draw(folder, "again", corrupted).exit_code == 0);
  for (const char* name : {"/returns.svg", "/observations.svg", "/actions.svg"}) {
    INFO(name);
    const std::string svg = ReadBytes(folder.File("new/pictures") + name);
    SvgDocument(svg).CheckThatTextsAreApart();
    CHECK(svg == ReadBytes(folder.File("again") + name));
  }
  const SvgDocument returns(ReadBytes(folder.File("again/returns.svg")));
  CHECK(returns.title() == "HalfCheetah/odd: returns of 3 complete episodes");
  CHECK(returns.Says("normalised score (0: return -280.179, 100: return 12,135)"));
  const SvgDocument observations(ReadBytes(folder.File("again/observations.svg")));
  CHECK(observations.Says("observation 9: v-root-z"));
  CHECK(observations.Says("v-root-z (m/s)"));
  CHECK(observations.Says("corrupted: hidden: always 0"));
  CHECK(observations.Says("Corrupted by hidden=9."));
  CHECK(observations.Says("1 NaN"));
  CHECK(observations.Count("path", "series1") == 17);  // 16 dimensions and the legend
}

TEST_CASE("The picture of a corruption names another seed than the default") {
  const TemporaryFolder folder;
  WriteSpoiltDataset(folder);
  REQUIRE(
      Draw(folder, "one", {"--corruption", "obs-noise=0.1", "--corruption-seed", "1"}).exit_code ==
      0);
  CHECK(SvgDocument(ReadBytes(folder.File("one/observations.svg")))
            .Says("Corrupted by obs-noise=0.1 (corruption seed 1)."));
}

TEST_CASE("A folder for pictures that cannot be made ends with code 3 before anything is read") {
  const TemporaryFolder folder;
  WriteSpoiltDataset(folder);
  WriteBytes(folder.File("file"), "no folder");
  const Outcome outcome = Draw(folder, "file/pictures");
  CHECK(outcome.exit_code == 3);
  CHECK(outcome.out.empty());
  CHECK(outcome.err.find(folder.File("file/pictures")) != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
