// What a reader must know before the first number: how much ran, and how long beside the paper's.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

// "39 runs fill cells of 58 benchmarks: 115 of the paper's 391 cells, 53 of them with settled
// scores. ..."
std::string SummaryOf(const Evidence& evidence) {
  size_t filled = 0, settled = 0;
  std::set<std::string> theirs, ours;  // distinct runs of the paper, and those that we have too
  for (const auto& [name, score] : evidence.paper) {
    theirs.insert(score.runs);
    const CellScore* own = FindComparable(evidence.ours, name.first, name.second);
    if (own == nullptr) continue;
    ours.insert(score.runs);
    ++filled;
    settled += own->settled ? 1 : 0;
  }
  return fmt::format(
      "{} runs fill cells of {} benchmarks: {} of the paper's {} cells, {} of them with settled "
      "scores. A run fills many cells, of an online learner those of all datasets: counted once "
      "each, {} of the paper's {} runs are there.",
      std::ranges::count(evidence.table.runs(), true, &ScoredRun::fills_a_cell),
      evidence.table.benchmarks().size(), filled, evidence.paper.size(), settled, ours.size(),
      theirs.size());
}

// "1M (TD3, SAC), 100k (BC, IQL)".
std::string UpdatesOf(const Evidence& evidence) {
  std::map<std::string, std::pair<uint64_t, uint64_t>> ranges;  // by algorithm: least, most
  for (const ScoredRun& run : evidence.table.runs()) {
    if (!run.fills_a_cell) continue;
    const auto [range, is_new] =
        ranges.emplace(run.series.algorithm, std::pair(run.updates, run.updates));
    auto& [least, most] = range->second;
    least = std::min(least, run.updates);
    most = std::max(most, run.updates);
  }
  std::vector<std::string> algorithms;
  for (const auto& [algorithm, unused] : ranges) algorithms.push_back(algorithm);
  std::ranges::stable_sort(algorithms, {}, OrderOf);
  std::vector<std::pair<std::string, std::vector<std::string>>> groups;  // by their updates
  for (const std::string& algorithm : algorithms) {
    const auto& [least, most] = ranges.at(algorithm);
    const std::string updates = RangeOf(Amount(least), Amount(most));
    auto group = std::ranges::find(groups, updates, [](const auto& each) { return each.first; });
    if (group == groups.end()) group = groups.insert(group, {updates, {}});
    group->second.push_back(DisplayName(algorithm));
  }
  std::vector<std::string> parts;
  for (const auto& [updates, names] : groups) {
    parts.push_back(fmt::format("{} ({})", updates, fmt::join(names, ", ")));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

// "1" or "1 to 3".
std::string SeedsOf(const Evidence& evidence) {
  size_t least = SIZE_MAX, most = 0;
  for (const auto& [name, score] : evidence.ours) {
    least = std::min(least, score.seeds);
    most = std::max(most, score.seeds);
  }
  return RangeOf(fmt::format("{}", least), fmt::format("{}", most));
}

// The paper's algorithms of which there is no run: "H2O".
std::string Lacking(const Evidence& evidence) {
  std::set<std::string> theirs, ours;
  for (const auto& [name, unused] : evidence.paper) theirs.insert(name.second);
  for (const auto& [name, unused] : evidence.ours) ours.insert(name.second);
  std::vector<std::string> lacking;
  std::ranges::set_difference(theirs, ours, std::back_inserter(lacking));
  std::ranges::stable_sort(lacking, {}, OrderOf);
  for (std::string& name : lacking) name = DisplayName(name);
  return fmt::format("{}", fmt::join(lacking, ", "));
}

// Runs on D4RL's own files; "" if there are none.
std::string D4rlRunsOf(const Evidence& evidence) {
  const auto runs = std::ranges::count_if(evidence.table.runs(), [](const ScoredRun& run) {
    return run.fills_a_cell && run.HasD4rlsData();
  });
  if (runs == 0) return "";
  return fmt::format(" Of the runs here {} learned from D4RL's files, and have their own columns.",
                     runs);
}

// Ours beside the paper's: seeds, updates and data.
std::string EffortOf(const Evidence& evidence) {
  if (evidence.ours.empty()) return "Nothing of it has run yet.";
  const std::string lacking = Lacking(evidence);
  return fmt::format(
      "Compare with care. Seeds a cell: ours {}, the paper's 3. Updates: ours {}; the paper does "
      "not say how many it took, most of the authors of its algorithms take 1M. Datasets: the "
      "paper's are D4RL's, this project's are recordings of its own agents at the same levels, "
      "which data/DATASHEET.md describes; the expert of HalfCheetah's scores 77, and that of "
      "late-expert 91.{}{}",
      SeedsOf(evidence), UpdatesOf(evidence), D4rlRunsOf(evidence),
      lacking.empty() ? "" : fmt::format(" Nothing of {} has run yet.", lacking));
}

// Runs on other data than a benchmark's; "" if there are none.
std::string OtherRowsOf(const Evidence& evidence) {
  if (!evidence.other_rows) return "";
  const OtherRows& others = *evidence.other_rows;
  return fmt::format(
      "Not to be compared: {} of the runs learned from other rows than those published as their "
      "dataset, for example from {} instead of {} rows of {}.",
      others.runs, Amount(others.rows), Amount(others.published), others.dataset);
}

// Which recipe stands for an algorithm that ran with several; "" if none has.
std::string RecipesOf(const Evidence& evidence) {
  std::vector<std::string> names;
  for (const Series& series : evidence.table.series()) {
    const auto is_other = [&](const Series& each) {
      return each.algorithm == series.algorithm && each != series;
    };
    if (evidence.table.MainSeries(series.algorithm) == series &&
        std::ranges::any_of(evidence.table.series(), is_other)) {
      names.push_back(DisplayName(series));
    }
  }
  if (names.empty()) return "";
  return fmt::format(
      "Where an algorithm ran with several recipes (in brackets behind its name), each has its "
      "column, its curves and its cells; everywhere else one stands for it, that of the budget "
      "(--at, or small) or, if it never ran with that, the one that fills the most cells: {}. On a "
      "benchmark where that has no result, one that has stands for it, but none on other data.",
      fmt::join(names, ", "));
}

}  // namespace

std::vector<Block> Opening(const Evidence& evidence) {
  std::vector<Block> blocks;
  blocks.emplace_back(Paragraph{fmt::format(
      "{} Made by b4mrl report from the results, and benchmarks/explanations.toml, beside the "
      "figures of \"Benchmarks for Reinforcement Learning with Biased Offline Data and Imperfect "
      "Simulators\" (arXiv 2407.00806), of which this is an independent implementation.",
      SummaryOf(evidence))});
  blocks.emplace_back(Paragraph{EffortOf(evidence)});
  for (const std::string& text : {OtherRowsOf(evidence), RecipesOf(evidence)}) {
    if (!text.empty()) blocks.emplace_back(Paragraph{text});
  }
  return blocks;
}

}  // namespace b4mrl
