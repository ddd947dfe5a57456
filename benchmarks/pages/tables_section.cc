// The paper's tables and those of the other challenges: every benchmark with all algorithms.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "benchmarks/evidence/hybrid_gain.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

// Another way to see the agent of a cell: a key of ScoredRun::further.
struct Seen {
  const char* name;
  const char* shown;
};
constexpr Seen kSeen[] = {{"full", "ours, nothing hidden"}, {"served", "ours, through its noise"}};

using Gains = std::map<CellName, HybridGain>;

class ChallengeTable {
 public:
  // All references outlive the object.
  ChallengeTable(const Evidence& evidence, const Gains& gains, const Gains& paper_gains,
                 std::vector<const Benchmark*> benchmarks);
  Table Make(std::string id, std::string title, std::string caption) const;

 private:
  std::vector<std::string> Row(const Benchmark& benchmark, std::string whose) const;
  std::string PaperEntry(const Benchmark& benchmark, const Series& series) const;
  std::string OwnEntry(const Benchmark& benchmark, const Series& series) const;
  // The mean over seeds of an agent's score when it is seen otherwise; "" if no cell has one.
  std::string SeenEntry(const Cell* cell, const std::string& name) const;
  void AddRows(const Benchmark& benchmark, Table* table) const;
  void AddGains(const Benchmark& benchmark, const Gains& gains,
                std::vector<std::string>* row) const;

  const Evidence& evidence_;
  const Gains& gains_;
  const Gains& paper_gains_;
  std::vector<const Benchmark*> benchmarks_;
  std::vector<Series> series_;        // the columns
  std::vector<std::string> hybrids_;  // columns of their gains
};

ChallengeTable::ChallengeTable(const Evidence& evidence, const Gains& gains,
                               const Gains& paper_gains, std::vector<const Benchmark*> benchmarks)
    : evidence_(evidence),
      gains_(gains),
      paper_gains_(paper_gains),
      benchmarks_(std::move(benchmarks)) {
  std::set<Series> series;
  std::set<std::string> hybrids;
  for (const Benchmark* benchmark : benchmarks_) {
    for (const Series& each : evidence_.table.series()) {
      if (evidence_.table.Find(benchmark->name, each) != nullptr) series.insert(each);
    }
    for (const std::string& algorithm : benchmark->exceptions) series.insert({algorithm, ""});
    for (const Gains* all : {&gains_, &paper_gains_}) {
      for (const auto& [name, gain] : *all) {
        if (name.first == benchmark->name) hybrids.insert(name.second);
      }
    }
  }
  const auto add_column = [&](const std::string& algorithm) {
    const bool has_column = std::ranges::any_of(
        series, [&](const Series& each) { return each.algorithm == algorithm; });
    if (!has_column) series.insert({algorithm, ""});
  };
  for (const Benchmark* benchmark : benchmarks_) {
    for (const auto& [algorithm, unused] : benchmark->paper) add_column(algorithm);
    for (const std::string& algorithm : benchmark->algorithms) add_column(algorithm);
  }
  series_.assign(series.begin(), series.end());
  std::ranges::stable_sort(series_, {}, [](const Series& each) { return OrderOf(each.algorithm); });
  hybrids_.assign(hybrids.begin(), hybrids.end());
  std::ranges::stable_sort(hybrids_, {}, OrderOf);
}

std::vector<std::string> ChallengeTable::Row(const Benchmark& benchmark, std::string whose) const {
  return {LevelOf(benchmark), FlawsOf(benchmark), std::move(whose)};
}

std::string ChallengeTable::OwnEntry(const Benchmark& benchmark, const Series& series) const {
  const Cell* cell = evidence_.table.Find(benchmark.name, series);
  if (cell != nullptr) return CellEntry(*cell);
  return benchmark.DefinedFor(series.algorithm) ? kMissing : kNotDefined;
}

std::string ChallengeTable::PaperEntry(const Benchmark& benchmark, const Series& series) const {
  // The paper's scores stand in the column of the algorithm's main series.
  const auto main = evidence_.table.MainSeries(series.algorithm);
  const bool has_column = main && std::ranges::count(series_, *main) > 0;
  if (has_column && *main != series) return "";
  const CellScore* score = b4mrl::Find(evidence_.paper, benchmark.name, series.algorithm);
  return score == nullptr ? kMissing : ScoreEntry(*score);
}

std::string ChallengeTable::SeenEntry(const Cell* cell, const std::string& name) const {
  if (cell == nullptr) return "";
  const auto mean = cell->MeanOf([&](const ScoredRun& run) {
    const auto found = run.further.find(name);
    return found == run.further.end() ? std::nullopt : std::optional(found->second);
  });
  return mean ? fmt::format("{:.1f}", *mean) : "";
}

void ChallengeTable::AddGains(const Benchmark& benchmark, const Gains& gains,
                              std::vector<std::string>* row) const {
  for (const std::string& hybrid : hybrids_) {
    const auto found = gains.find({benchmark.name, hybrid});
    if (found == gains.end()) {
      row->emplace_back(kMissing);
      continue;
    }
    std::string text = Signed(found->second.gain);
    if (!found->second.settled) text += fmt::format(" {}", kUnsettledMark);
    row->push_back(std::move(text));
  }
}

void ChallengeTable::AddRows(const Benchmark& benchmark, Table* table) const {
  std::vector<std::string> ours = Row(benchmark, "ours");
  for (const Series& series : series_) ours.push_back(OwnEntry(benchmark, series));
  AddGains(benchmark, gains_, &ours);
  table->rows.push_back(std::move(ours));
  for (const Seen& seen : kSeen) {
    std::vector<std::string> row = Row(benchmark, seen.shown);
    bool has_any = false;
    for (const Series& series : series_) {
      row.push_back(SeenEntry(evidence_.table.Find(benchmark.name, series), seen.name));
      has_any |= !row.back().empty();
    }
    row.resize(row.size() + hybrids_.size());
    if (has_any) table->rows.push_back(std::move(row));
  }
  if (benchmark.paper.empty()) return;
  std::vector<std::string> paper = Row(benchmark, "paper");
  for (const Series& series : series_) paper.push_back(PaperEntry(benchmark, series));
  AddGains(benchmark, paper_gains_, &paper);
  table->rows.push_back(std::move(paper));
}

Table ChallengeTable::Make(std::string id, std::string title, std::string caption) const {
  Table table = {std::move(id), std::move(title), std::move(caption), {}, {}};
  table.columns = {{"Dataset"}, {"What is wrong"}, {"Whose"}};
  for (const Series& series : series_) table.columns.push_back({DisplayName(series), true});
  for (const std::string& hybrid : hybrids_) {
    table.columns.push_back({DisplayName(hybrid) + " gain", true});
  }
  for (const Benchmark* benchmark : benchmarks_) AddRows(*benchmark, &table);
  return table;
}

}  // namespace

Section TablesSection(const Evidence& evidence) {
  Section section;
  section.title = "Scores, beside the paper's";
  section.blocks.emplace_back(Paragraph{fmt::format(
      "Scores are normalised as in D4RL: 0 is a random policy, 100 D4RL's expert; Highway's are "
      "returns. They are those of a run's last evaluation. Behind ours stand seeds × updates; ± is "
      "the standard deviation over seeds (with their number as divisor), which a single seed has "
      "not. {} marks a cell of which a run still goes on, or whose mean score over its seeds rises "
      "by more than 1.5 points (a return by more than 3% of what its curve spans) from the last "
      "fifth but one of the training to the last, {} one that falls by more than that, {} one that "
      "was evaluated too rarely to say; none of them, where the learning rates of the policies "
      "have fallen to 0. Such cells decide nothing below, and {} marks what is reckoned from them. "
      "A cell without a mark has settled, which is not to say that ten times "
      "the updates would add nothing. {} is a cell that nothing has filled yet or, of the paper, "
      "an algorithm that it has not; {} one that is not defined. \"Ours, nothing hidden\" and "
      "\"ours, through its noise\" are the same agents on other observations: without the mask, or "
      "with the noise, of their training. Nothing hidden is no full information: in training these "
      "inputs were always 0, so their weights are still those of the first draw. Both are blank "
      "unless all agents of the cell were evaluated so. The gain of a hybrid is its score minus "
      "the best of TD3, SAC, BC, MOPO, TD3-BC and IQL in that row.",
      kRisingMark, kFallingMark, kUntoldMark, kUnsettledMark, kMissing, kNotDefined)});
  // One table for each environment's challenge of which there is a score, in the order of the
  // suites.
  const auto title_of = [](const Benchmark& benchmark) {
    return fmt::format("{}, {}", benchmark.environment, benchmark.challenge);
  };
  std::set<std::string> shown;
  for (const Benchmark& benchmark : evidence.benchmarks) {
    const bool has_own = std::ranges::count(evidence.table.benchmarks(), &benchmark) > 0;
    if (has_own || !benchmark.paper.empty()) shown.insert(title_of(benchmark));
  }
  std::vector<std::pair<std::string, std::vector<const Benchmark*>>> tables;
  for (const Benchmark& benchmark : evidence.benchmarks) {
    const std::string title = title_of(benchmark);
    if (!shown.contains(title)) continue;
    auto table = std::ranges::find(tables, title, [](const auto& each) { return each.first; });
    if (table == tables.end()) table = tables.insert(table, {title, {}});
    table->second.push_back(&benchmark);
  }
  const Gains gains = ByCell(HybridGains(evidence.ours, evidence.benchmarks));
  const Gains paper_gains = ByCell(HybridGains(evidence.paper, evidence.benchmarks));
  for (const auto& [title, benchmarks] : tables) {
    const Benchmark& first = *benchmarks.front();
    section.blocks.emplace_back(ChallengeTable(evidence, gains, paper_gains, benchmarks)
                                    .Make(fmt::format("{}-{}", first.environment, first.challenge),
                                          title + ".", OriginOf(first)));
  }
  return section;
}

}  // namespace b4mrl
