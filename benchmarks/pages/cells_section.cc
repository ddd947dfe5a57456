// Every cell with its interval and its cost, and the same numbers for programs.
#include <fmt/format.h>

#include <set>

#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

// For programs: more digits than any score has, fewer than processors could differ in.
std::string Digits(double value) { return fmt::format("{:.6g}", value); }

// Means over the runs. Nothing if one is read before its end: results say what the whole run cost.
std::optional<double> CoreHours(const Cell& cell) {
  return cell.MeanOf([](const ScoredRun& run) {
    return run.is_part ? std::nullopt : std::optional(run.core_hours);
  });
}
std::optional<double> CountPerRun(const Cell& cell, std::optional<uint64_t> ScoredRun::*member) {
  return cell.MeanOf([member](const ScoredRun& run) -> std::optional<double> {
    if (run.is_part || !(run.*member)) return std::nullopt;
    return static_cast<double>(*(run.*member));
  });
}

// Calls use(benchmark, series, cell) for every cell, benchmark by benchmark.
template <typename Use>
void ForEachCell(const ScoreTable& table, Use use) {
  for (const Benchmark* benchmark : table.benchmarks()) {
    for (const Series& series : table.series()) {
      const Cell* cell = table.Find(benchmark->name, series);
      if (cell != nullptr) use(*benchmark, series, *cell);
    }
  }
}

// What the paper's tables call a flaw and a dataset.
struct PaperWord {
  const char* challenge;  // of those of which the word is said
  const char* ours;
  const char* theirs;
};
constexpr PaperWord kPaperWords[] = {
    {"partial-observability-simulator", "obs-noise-low", "sigma_low"},
    {"partial-observability-simulator", "obs-noise-high", "sigma_high"},
    {"partial-observability-simulator", "hidden-low", "h_low"},
    {"partial-observability-simulator", "hidden-high", "h_high"},
    {"confounding", "obs-noise-low", "sigma_low"},
    {"confounding", "obs-noise-high", "sigma_high"},
    {"confounding", "hidden-low", "h_low"},
    {"confounding", "hidden-high", "h_high"},
    {"action-discrepancy", "action-noise-low", "sigma_low"},
    {"action-discrepancy", "action-noise-high", "sigma_high"},
    {"partial-observability-dataset", "partial-low", "h_low"},
    {"partial-observability-dataset", "partial-low-history", "h_low-history"},
    {"partial-observability-dataset", "partial-high", "h_high"},
    {"partial-observability-dataset", "partial-high-history", "h_high-history"},
};

std::string PaperWordOf(const std::string& challenge, const std::string& ours) {
  for (const PaperWord& word : kPaperWords) {
    if (challenge == word.challenge && ours == word.ours) return word.theirs;
  }
  return ours;
}

}  // namespace

Section CellsSection(const Evidence& evidence) {
  Section section;
  section.title = "Every cell: interval, cost, interactions";
  Table table;
  table.id = "cells";
  table.title = "Scores beside what they cost.";
  table.caption = fmt::format(
      "A run that fills the cells of several benchmarks stands once, at the first of them. Last "
      "fifth: the mean score over the last fifth of the run; a doubling adds: the points by which "
      "each doubling of the updates raises the score, in the second half of the run. Intervals of "
      "95%: by Student's t from three seeds on; * with fewer seeds, where the deviation between "
      "seeds is the algorithm's, pooled over our cells with three seeds or, while there are fewer "
      "than ten of those, over the paper's (the root of the mean square, each of its runs once; of "
      "BC, which the paper has not, TD3-BC's). The paper's deviations stand as it prints them; it "
      "does not say by what they are divided, and if that is the number of its seeds, three, these "
      "intervals should be 1.22 times as wide; a borrowed deviation is taken for exact. An "
      "interval is about other seeds, around the last evaluation: a last fifth outside of it shows "
      "that the evaluations of one run vary more. Core-hours are those of one run, evaluations "
      "included, but without the training of an ensemble that an earlier run on the same machine "
      "had kept; interactions are counted by the daemon; {} where a run is read before its end.",
      kMissing);
  table.columns = {{"Benchmark"},        {"Algorithm"},
                   {"Score", true},      {"95% interval", true},
                   {"Last fifth", true}, {"A doubling adds", true},
                   {"Seeds", true},      {"Updates", true},
                   {"Core-hours", true}, {"Simulator steps", true},
                   {"Query rows", true}, {"Dataset rows", true}};
  std::set<std::string> shown;
  ForEachCell(evidence.table,
              [&](const Benchmark& benchmark, const Series& series, const Cell& cell) {
                const CellScore score = ScoreOf(benchmark, cell, evidence.deviations);
                if (!shown.insert(score.runs).second) return;
                table.rows.push_back({benchmark.name, DisplayName(series), ScoreEntry(score),
                                      IntervalEntry(score), Fixed(score.last_fifth, 1),
                                      GainEntry(score), fmt::format("{}", score.seeds),
                                      UpdatesEntry(cell), Fixed(CoreHours(cell), 2),
                                      Amount(CountPerRun(cell, &ScoredRun::simulator_steps)),
                                      Amount(CountPerRun(cell, &ScoredRun::query_rows)),
                                      Amount(CountPerRun(cell, &ScoredRun::dataset_rows))});
              });
  section.blocks.emplace_back(std::move(table));
  return section;
}

Table CellsAsNumbers(const Evidence& evidence) {
  Table table;
  table.id = "scores";
  for (const char* name :
       {"benchmark", "algorithm", "recipe", "mean", "std", "seeds", "updates", "settled", "low",
        "high", "borrowed_deviation", "paper_mean", "paper_std", "core_hours", "simulator_steps",
        "query_rows", "dataset_rows"}) {
    table.columns.push_back({name});
  }
  const auto count = [](const std::optional<double>& number) {
    return number ? fmt::format("{:.0f}", *number) : std::string();
  };
  ForEachCell(evidence.table,
              [&](const Benchmark& benchmark, const Series& series, const Cell& cell) {
                const CellScore score = ScoreOf(benchmark, cell, evidence.deviations);
                const auto interval = score.Interval95();
                const auto hours = CoreHours(cell);
                const CellScore* paper = Find(evidence.paper, benchmark.name, series.algorithm);
                table.rows.push_back(
                    {benchmark.name, series.algorithm, series.recipe, Digits(score.mean),
                     score.seeds > 1 ? Digits(score.std) : "", fmt::format("{}", score.seeds),
                     fmt::format("{}", cell.LeastUpdates()), score.settled ? "yes" : "no",
                     interval ? Digits(interval->low) : "", interval ? Digits(interval->high) : "",
                     score.is_borrowed ? "yes" : "no", paper != nullptr ? Digits(paper->mean) : "",
                     paper != nullptr ? Digits(paper->std) : "", hours ? Digits(*hours) : "",
                     count(CountPerRun(cell, &ScoredRun::simulator_steps)),
                     count(CountPerRun(cell, &ScoredRun::query_rows)),
                     count(CountPerRun(cell, &ScoredRun::dataset_rows))});
              });
  return table;
}

Table CellsAsThePaper(const Evidence& evidence) {
  Table table;
  table.id = "halfcheetah_results";
  for (const char* name :
       {"table", "challenge", "dataset", "discrepancy", "algorithm", "mean", "std"}) {
    table.columns.push_back({name});
  }
  for (const Benchmark& benchmark : evidence.benchmarks) {
    const std::string of_paper = PaperTableOf(benchmark.challenge);
    if (benchmark.environment != "HalfCheetah" || of_paper.empty() || benchmark.dataset.empty())
      continue;
    const std::string& flaw =
        benchmark.corruption.empty() ? benchmark.simulator : benchmark.corruption;
    for (auto entry = evidence.ours.lower_bound({benchmark.name, ""});
         entry != evidence.ours.end() && entry->first.first == benchmark.name; ++entry) {
      const CellScore& score = entry->second;
      table.rows.push_back(
          {of_paper, benchmark.challenge, PaperWordOf(benchmark.challenge, LevelOf(benchmark)),
           PaperWordOf(benchmark.challenge, flaw), DisplayName(entry->first.second),
           Fixed(score.mean, 1), score.seeds > 1 ? fmt::format("{:.1f}", score.std) : ""});
    }
  }
  return table;
}

}  // namespace b4mrl
