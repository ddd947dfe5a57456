// A report says the same of equal results, and shows whatever the results hold.
#include "benchmarks/pages/report.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "benchmarks/pages/writers.h"
#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

constexpr char kConfounded[] = "HalfCheetah/confounding/hidden-high+medium";

std::string MarkdownOf(const ReportOptions& options) {
  return ToMarkdown(MakeReport(Take(GatherEvidence(options))));
}

// The names of all files under a folder, in alphabetical order.
std::vector<std::string> FilesOf(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      names.push_back(std::filesystem::relative(entry.path(), folder).string());
    }
  }
  std::ranges::sort(names);
  return names;
}

TEST_CASE("The committed results make the committed report, one page of at most 5 MB") {
  const TemporaryFolder folder;
  const Evidence evidence =
      Take(GatherEvidence({.folder = B4MRL_SOURCE_DIR "/benchmarks/results"}));
  RequireOk(WriteReport(evidence, folder.File("one")));
  RequireOk(WriteReport(evidence, folder.File("two")));
  // Made by `b4mrl report benchmarks/results --out benchmarks/report`.
  const std::string committed = B4MRL_SOURCE_DIR "/benchmarks/report";
  const std::vector<std::string> files = FilesOf(folder.File("one"));
  CHECK(files.size() > 20);
  CHECK(files == FilesOf(committed));
  for (const std::string& name : files) {
    CAPTURE(name);
    const std::string made = ReadBytes(folder.File("one/" + name));
    const bool is_made_again = made == ReadBytes(folder.File("two/" + name));
    const bool is_committed = made == ReadBytes(committed + "/" + name);
    CHECK(is_made_again);
    CHECK(is_committed);
  }
  const std::string page = ReadBytes(folder.File("one/report.html"));
  CHECK(page.size() <= 5'000'000);
  CHECK(page.find("<script") == std::string::npos);
  CHECK(page.find(folder.path()) == std::string::npos);
}

TEST_CASE("No table of a report has two columns of one name") {
  const Document report =
      MakeReport(Take(GatherEvidence({.folder = B4MRL_SOURCE_DIR "/benchmarks/results"})));
  for (const Table* table : report.All<Table>()) {
    std::set<std::string> names;
    for (const Column& column : table->columns) {
      CAPTURE(table->id, column.name);
      CHECK(names.insert(column.name).second);
    }
  }
}

TEST_CASE("Runs on other rows than the published ones are compared with nothing of the paper's") {
  const std::string gravity = "HalfCheetah/modelling-error/gravity+medium";
  const MadeResults results({{.algorithm = "iql", .benchmarks = {gravity}, .score = 1, .rows = "x"},
                             {.algorithm = "bc", .benchmarks = {gravity}, .score = 2}});
  const Document report = MakeReport(Take(GatherEvidence({.folder = results.path()})));
  const std::string text = ToMarkdown(report);
  CHECK_THAT(text, Catch::Contains("Not to be compared: 1 of the runs"));
  CHECK_THAT(text, Catch::Contains("0 of the paper's 391 cells"));
  CHECK_THAT(text, !Catch::Contains("unexplained"));
  for (const Table* table : report.All<Table>()) {
    CHECK(table->id != "levels");
    CHECK(table->id != "deviations");
  }
}

TEST_CASE("A user's own algorithm appears beside the others") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kConfounded}, .score = 40},
       {.algorithm = "my-own", .benchmarks = {kConfounded}, .score = 45, .source = "user"}});
  const std::string report = MarkdownOf({.folder = results.path()});
  CHECK_THAT(report, Catch::Contains("| my-own |"));
  CHECK_THAT(report, Catch::Contains("my-own gain"));
  CHECK_THAT(report, Catch::Contains("| " + std::string(kConfounded) + " | my-own | +5.0 |"));
  CHECK_THAT(report, Catch::Contains("ours, nothing hidden"));
  const Document document = MakeReport(Take(GatherEvidence({.folder = results.path()})));
  for (const Picture* picture : document.All<Picture>()) {
    if (picture->id == "profiles" || picture->id.starts_with("hidden-dimensions")) continue;
    CAPTURE(picture->id);
    CHECK(std::ranges::any_of(picture->figure.series,
                              [](const auto& name) { return name.starts_with("my-own"); }));
  }
}

TEST_CASE(
    "A report begins with the seeds and updates of its runs, and with the recipe that counts") {
  const std::string gravity = "HalfCheetah/modelling-error/gravity+medium";
  const MadeResults results(
      {{.algorithm = "mopo", .benchmarks = {gravity, kConfounded}, .score = 40, .recipe = "short"},
       {.algorithm = "mopo", .benchmarks = {gravity}, .score = 50, .recipe = "long"},
       {.algorithm = "hymopo",
        .benchmarks = {gravity, kConfounded},
        .score = 45,
        .recipe = "short"},
       {.algorithm = "hymopo", .benchmarks = {gravity}, .score = 53, .recipe = "long"}});
  const std::string report = MarkdownOf({.folder = results.path()});
  const std::string opening = report.substr(0, report.find("\n## "));
  CHECK_THAT(opening, Catch::Contains("ours 1, the paper's 3. Updates: ours 1k (MOPO, HyMOPO);"));
  CHECK_THAT(opening, Catch::Contains("Nothing of TD3, SAC, TD3-BC, IQL, H2O has run yet."));
  CHECK_THAT(opening, Catch::Contains("most cells: MOPO (short), HyMOPO (short)."));
  // Each recipe's gain is taken from its own.
  const std::string row = "| " + gravity + " | HyMOPO ";
  CHECK_THAT(report, Catch::Contains(row + "(short) | +5.0 | MOPO (short) (of 1) |"));
  CHECK_THAT(report, Catch::Contains(row + "(long) | +3.0 | MOPO (long) (of 1) |"));
  CHECK_THAT(report, Catch::Contains("HyMOPO: on no benchmark beside all others; on 2 more "));
}

TEST_CASE("The recipe of the budget stands for an algorithm, however few cells it fills") {
  const std::string gravity = "HalfCheetah/modelling-error/gravity+medium";
  const MadeResults results(
      {{.algorithm = "mopo", .benchmarks = {gravity, kConfounded}, .score = 40, .recipe = "short"},
       {.algorithm = "mopo", .benchmarks = {gravity}, .score = 50, .recipe = "long-ensemble"}});
  const auto main_at = [&](const std::string& at) {
    return Take(GatherEvidence({.folder = results.path(), .at = at})).table.MainSeries("mopo");
  };
  CHECK(main_at("") == Series{"mopo", "long-ensemble"});  // as in `small`
  CHECK(main_at("500") == Series{"mopo", "long-ensemble"});
  CHECK(main_at("short-ensemble") == Series{"mopo", "short"});
  CHECK(main_at("paper") == Series{"mopo", "short"});  // which fills most, for none has its recipe
}

TEST_CASE("A table shows all benchmarks of a challenge of which there is a score") {
  const MadeResults results({{.algorithm = "td3-bc",
                              .benchmarks = {"HalfCheetah/dimensions/hidden=9+medium-expert"},
                              .score = 40}});
  const Document report = MakeReport(Take(GatherEvidence({.folder = results.path()})));
  const auto tables = report.All<Table>();
  const auto dimensions =
      std::ranges::find(tables, std::string("HalfCheetah-dimensions"), &Table::id);
  REQUIRE(dimensions != tables.end());
  // 17 of SAC, 17 of TD3-BC, and the one that is seen otherwise.
  CHECK((*dimensions)->rows.size() == 35);
}

TEST_CASE("Scores at a budget are those that the runs had then") {
  const MadeResults results(
      {{.algorithm = "iql", .benchmarks = {kConfounded}, .score = 40, .settled = false}});
  CHECK_THAT(MarkdownOf({.folder = results.path()}), Catch::Contains("40.0 ↗ (1×1k)"));
  CHECK_THAT(MarkdownOf({.folder = results.path(), .at = "200"}),
             Catch::Contains("32.0 ? (1×200)"));  // of two evaluations nobody can tell
  CHECK_THAT(MarkdownOf({.folder = results.path(), .at = "800"}),
             Catch::Contains("38.0 ↗ (1×800)"));
  CHECK_THAT(MarkdownOf({.folder = results.path(), .at = "small"}), Catch::Contains("(1×1k)"));
  const MadeResults falling({{.algorithm = "iql",
                              .benchmarks = {kConfounded},
                              .score = 40,
                              .settled = false,
                              .rise = -1}});
  CHECK_THAT(MarkdownOf({.folder = falling.path()}), Catch::Contains("40.0 ↘ (1×1k)"));
  const auto unknown = GatherEvidence({.folder = results.path(), .at = "smalll"});
  REQUIRE_FALSE(unknown.ok());
  CHECK_THAT(unknown.status().message(), Catch::Contains("smalll"));
}

TEST_CASE("Where a run is read before its end, what all of it cost does not stand beside") {
  const MadeResults results({{.algorithm = "iql", .benchmarks = {kConfounded}, .score = 40}});
  const auto row_at = [&](const std::string& at) {
    const Document report = MakeReport(Take(GatherEvidence({.folder = results.path(), .at = at})));
    const auto tables = report.All<Table>();
    return (*std::ranges::find(tables, std::string("cells"), &Table::id))->rows.at(0);
  };
  const std::vector<std::string> whole = row_at(""), part = row_at("500");
  const auto costs = [](const std::vector<std::string>& row) {
    return std::vector(row.end() - 4, row.end());
  };
  CHECK(costs(whole) == std::vector<std::string>{"0.50", "1", "2", "3"});
  CHECK(costs(part) == std::vector<std::string>{"-", "-", "-", "-"});
}

TEST_CASE("An explanation is printed for the score that it is about, and for no other") {
  const std::string benchmark = "HalfCheetah/modelling-error/gravity+medium-expert";
  const auto is_explained = [&](double score) {
    const MadeResults results({{.algorithm = "iql", .benchmarks = {benchmark}, .score = score}});
    Evidence evidence = Take(GatherEvidence({.folder = results.path()}));
    evidence.explanations = {{{benchmark, "iql"}, {"30.0", "its brakes are on"}}};
    return ToMarkdown(MakeReport(evidence)).find("its brakes are on") != std::string::npos;
  };
  CHECK(is_explained(30));
  CHECK_FALSE(is_explained(31));
}

TEST_CASE("A user's benchmarks join the table of their challenge and change no claim") {
  const TemporaryFolder suites;
  WriteBytes(suites.File("mine.toml"),
             "version = \"v0\"\nenvironment = \"HalfCheetah\"\n[[challenge]]\n"
             "name = \"confounding\"\nsimulators = [\"gravity\"]\n"
             "corruptions = [\"hidden=3\"]\ndatasets = [\"medium\"]\n");
  const MadeResults results({{.algorithm = "iql",
                              .benchmarks = {"HalfCheetah/confounding/hidden=3+medium"},
                              .score = 40}});
  const Evidence alone = Take(GatherEvidence({.folder = results.path()}));
  const Evidence both = Take(GatherEvidence({.folder = results.path(), .suites = suites.path()}));
  REQUIRE(both.claims.size() == alone.claims.size());
  for (size_t i = 0; i < both.claims.size(); ++i) {
    CHECK(both.claims[i].higher.benchmarks == alone.claims[i].higher.benchmarks);
  }
  size_t tables = 0;
  const Document report = MakeReport(both);
  for (const Table* table : report.All<Table>()) {
    tables += table->id == "HalfCheetah-confounding" ? 1 : 0;
  }
  CHECK(tables == 1);
}

TEST_CASE("A folder without results is refused, like one that is missing") {
  const TemporaryFolder folder;
  const auto empty = GatherEvidence({.folder = folder.path()});
  REQUIRE_FALSE(empty.ok());
  CHECK_THAT(empty.status().message(), Catch::EndsWith("holds no results"));
  CHECK_FALSE(GatherEvidence({.folder = folder.File("none")}).ok());
}

}  // namespace
}  // namespace b4mrl
