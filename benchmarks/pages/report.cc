#include "benchmarks/pages/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "benchmarks/pages/writers.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/suite_plan.h"
#include "data/files/atomic_file.h"
#include "data/files/csv_lines.h"
#include "data/files/make_folder.h"
#include "data/files/toml_keys.h"
#include "proto/base/folders.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxParameterBytes = 1 << 16;
constexpr size_t kParameterColumns = 5;

std::string OwnFile(const std::string& name) {
  return SharedFolder("", B4MRL_BENCHMARKS_FOLDER) + "/" + name;
}

// [[explanation]] benchmark, algorithm, score, why: of scores that are far from the paper's.
Result<std::map<CellName, Explanation>> ReadExplanations(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table file, ReadTomlFile(path));
  TomlKeys keys(file, path);
  B4MRL_ASSIGN_OR_RETURN(const auto tables, keys.Tables("explanation"));
  B4MRL_RETURN_IF_ERROR(keys.Finish());
  std::map<CellName, Explanation> explanations;
  for (size_t i = 0; i < tables.size(); ++i) {
    TomlKeys entry(*tables[i], fmt::format("{}, explanation {}", path, i + 1));
    B4MRL_ASSIGN_OR_RETURN(const std::string benchmark, entry.Text("benchmark", true));
    B4MRL_ASSIGN_OR_RETURN(const std::string algorithm, entry.Text("algorithm", true));
    Explanation explanation;
    B4MRL_ASSIGN_OR_RETURN(explanation.score, entry.Text("score", true));
    B4MRL_ASSIGN_OR_RETURN(explanation.why, entry.Text("why", true));
    B4MRL_RETURN_IF_ERROR(entry.Finish());
    explanations[CellName(benchmark, algorithm)] = std::move(explanation);
  }
  return explanations;
}

// benchmarks/paper_parameters.csv without its first line.
Result<std::vector<std::vector<std::string>>> ReadParameters(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxParameterBytes));
  std::vector<std::vector<std::string>> rows;
  for (const std::string_view line : LinesOf(text)) {
    const auto cells = CellsOf(line);
    rows.emplace_back(cells.begin(), cells.end());
    rows.back().resize(kParameterColumns);
  }
  if (!rows.empty()) rows.erase(rows.begin());
  return rows;
}

// What --at, empty or a number or a budget, makes count of the results.
struct Reading {
  ReadingLimit limit;
  std::map<std::string, std::string> main_recipes;  // of that budget, or of the runner's own
  std::vector<std::string> numbers;  // simulators of the budget's exceptions, given by numbers
};

// Results have a preset's name where there is one, which numbers would never fit.
Status CheckNumbers(const std::vector<std::string>& numbers, const ScoreTable& table) {
  for (const std::string& simulator : numbers) {
    const auto& runs = table.runs();
    if (std::ranges::find(runs, simulator, &ScoredRun::simulator) != runs.end()) continue;
    return InvalidArgument("simulator of an exception in the budget of --at", simulator,
                           "one of a result, a preset by its name");
  }
  return Status();
}

std::map<std::string, std::string> MainRecipesBy(const Budget& budget) {
  std::map<std::string, std::string> recipes;
  for (const auto& [algorithm, unused] : budget.updates) {
    recipes[algorithm] = budget.RecipeOf(algorithm);
  }
  return recipes;
}

Result<Reading> ReadingOf(const std::string& at) {
  const bool is_number = at.find_first_not_of("0123456789") == std::string::npos;
  B4MRL_ASSIGN_OR_RETURN(const Budget budget, FindBudget(is_number ? kDefaultBudget : at));
  Reading reading = {{}, MainRecipesBy(budget)};
  if (at.empty()) return reading;
  if (is_number) {
    B4MRL_ASSIGN_OR_RETURN(const uint64_t updates, ParseUnsigned("--at", at, 1, UINT64_MAX));
    reading.limit = [updates](const ScoredRun&) { return std::optional(updates); };
    return reading;
  }
  for (const BudgetException& exception : budget.exceptions) {
    for (const std::string& simulator : exception.simulators) {
      if (simulator.find('=') != std::string::npos) reading.numbers.push_back(simulator);
    }
  }
  reading.limit = [budget](const ScoredRun& run) {
    if (run.source != "own") return budget.learner_updates;
    return budget.UpdatesOf(run.series.algorithm, run.simulator, run.dataset);
  };
  return reading;
}

}  // namespace

Result<Evidence> GatherEvidence(const ReportOptions& options) {
  Evidence evidence;
  B4MRL_ASSIGN_OR_RETURN(evidence.benchmarks, ReadBenchmarks(options.suites));
  B4MRL_ASSIGN_OR_RETURN(const Reading reading, ReadingOf(options.at));
  B4MRL_ASSIGN_OR_RETURN(const PublishedDatasets published, ReadPublishedDatasets());
  B4MRL_ASSIGN_OR_RETURN(evidence.table,
                         ScoreTable::Read(options.folder, evidence.benchmarks, reading.limit,
                                          reading.main_recipes, published));
  B4MRL_RETURN_IF_ERROR(CheckNumbers(reading.numbers, evidence.table));
  evidence.paper = PaperScores(evidence.benchmarks);
  evidence.deviations = BorrowedDeviations(evidence.table, evidence.paper);
  evidence.ours = OwnScores(evidence.table, evidence.deviations);
  evidence.other_rows = RunsOnOtherRows(evidence.table, published);
  // Claims about "confounding/*" are about the project's benchmarks, whatever others are named.
  B4MRL_ASSIGN_OR_RETURN(const auto own, ReadBenchmarks(""));
  B4MRL_ASSIGN_OR_RETURN(evidence.claims, ReadClaims(OwnFile("claims.toml"), own));
  B4MRL_ASSIGN_OR_RETURN(evidence.explanations, ReadExplanations(OwnFile("explanations.toml")));
  B4MRL_ASSIGN_OR_RETURN(evidence.parameters, ReadParameters(OwnFile("paper_parameters.csv")));
  return evidence;
}

Document MakeReport(const Evidence& evidence) {
  Document document;
  document.title = "B4MRL: benchmarks with a wrong simulator and biased data";
  document.opening = Opening(evidence);
  document.sections = {GainSection(evidence),      TablesSection(evidence),
                       FiguresSection(evidence),   ClaimsSection(evidence),
                       AgreementSection(evidence), AggregatesSection(evidence),
                       CurvesSection(evidence),    CellsSection(evidence),
                       ErrorsSection(evidence),    OriginSection(evidence)};
  return document;
}

Status WriteReport(const Evidence& evidence, const std::string& folder) {
  const Document document = MakeReport(evidence);
  B4MRL_RETURN_IF_ERROR(MakeFolder(folder + "/tables"));
  B4MRL_RETURN_IF_ERROR(MakeFolder(folder + "/figures"));
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(folder + "/report.md", ToMarkdown(document)));
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(folder + "/report.html", ToHtml(document)));
  for (const Picture* picture : document.All<Picture>()) {
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(fmt::format("{}/figures/{}.svg", folder, picture->id),
                                         RenderSvg(picture->figure)));
  }
  for (const Table* table : document.All<Table>()) {
    const std::string path = fmt::format("{}/tables/{}", folder, table->id);
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(path + ".csv", ToCsv(*table)));
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(path + ".tex", ToLatex(*table)));
  }
  for (const Table& table : {CellsAsNumbers(evidence), CellsAsThePaper(evidence)}) {
    B4MRL_RETURN_IF_ERROR(
        WriteSmallFile(fmt::format("{}/tables/{}.csv", folder, table.id), ToCsv(table)));
  }
  return Status();
}

}  // namespace b4mrl
