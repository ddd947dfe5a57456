// Whether hybrids are worth their two sources.
#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/evidence/hybrid_gain.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

// "HyMOPO: above 0 in 17 of 52 benchmarks" for each hybrid. Benchmarks where an algorithm with one
// source has not run, which might be the best, do not count. What has not settled is told apart,
// for runs in which nothing is learned settle first.
std::vector<std::string> CountsOf(const std::vector<HybridGain>& gains, const std::string& whose) {
  struct Count {
    size_t above = 0, all = 0, settled_above = 0, settled = 0, incomplete = 0;
  };
  std::map<std::string, Count> counts;
  for (const HybridGain& gain : gains) {
    Count& count = counts[gain.algorithm];
    if (!gain.has_papers) {
      ++count.incomplete;
      continue;
    }
    ++count.all;
    const size_t is_above = gain.gain > 0 ? 1 : 0;
    count.above += is_above;
    if (!gain.settled) continue;
    ++count.settled;
    count.settled_above += is_above;
  }
  std::vector<std::string> lines;
  for (const auto& [algorithm, count] : counts) {
    std::string line = fmt::format("{} {}: above 0 in {} of {} benchmarks", whose,
                                   DisplayName(algorithm), count.above, count.all);
    if (count.all == 0) {
      line = fmt::format("{} {}: on no benchmark beside all others", whose, DisplayName(algorithm));
    } else if (count.settled < count.all) {
      line += fmt::format("; where all scores have settled, in {} of {}", count.settled_above,
                          count.settled);
    }
    if (count.incomplete > 0) {
      line +=
          fmt::format("; on {} more an algorithm to compare with has not run", count.incomplete);
    }
    lines.push_back(line + ".");
  }
  return lines;
}

// "HyMOPO, where there are both: above 0 in 4 of the paper's 19 benchmarks, in 2 of ours" for each
// hybrid of which there is one with all algorithms to compare with.
std::vector<std::string> CountsOfBoth(const std::vector<HybridGain>& ours,
                                      const std::vector<HybridGain>& paper) {
  const std::map<CellName, HybridGain> by_cell = ByCell(paper);
  struct Count {
    size_t all = 0, ours = 0, paper = 0;
  };
  std::map<std::string, Count> counts;
  for (const HybridGain& gain : ours) {
    const auto theirs = by_cell.find({gain.benchmark, gain.algorithm});
    if (!gain.has_papers || theirs == by_cell.end()) continue;
    Count& count = counts[gain.algorithm];
    ++count.all;
    count.ours += gain.gain > 0 ? 1 : 0;
    count.paper += theirs->second.gain > 0 ? 1 : 0;
  }
  std::vector<std::string> lines;
  for (const auto& [algorithm, count] : counts) {
    lines.push_back(fmt::format(
        "{}, where there are both: above 0 in {} of the paper's {} benchmarks, in {} of ours.",
        DisplayName(algorithm), count.paper, count.all, count.ours));
  }
  return lines;
}

// The gains of hybrids that ran with other recipes than their main one, beside algorithms that ran
// with the same where there are any.
std::vector<HybridGain> GainsOfOtherRecipes(const Evidence& evidence) {
  std::vector<HybridGain> gains;
  for (const std::string& recipe : OtherRecipes(evidence.table)) {
    const CellScores scores = OwnScores(evidence.table, evidence.deviations, recipe);
    std::ranges::copy_if(HybridGains(scores, evidence.benchmarks), std::back_inserter(gains),
                         [&](const HybridGain& gain) {
                           const Series series = {gain.algorithm, gain.recipe};
                           return gain.recipe == recipe &&
                                  evidence.table.MainSeries(gain.algorithm) != series;
                         });
  }
  return gains;
}

Table GainsTable(const std::vector<HybridGain>& gains, const std::vector<HybridGain>& paper) {
  Table table;
  table.id = "gains";
  table.title = "Hybrid gain on each benchmark.";
  table.caption = fmt::format(
      "The best algorithm with one source is the best of those that have a score there: their "
      "number stands behind it, {} would be all. {}: one of the scores has not settled. In "
      "brackets: the recipe. Gains of a hybrid with another recipe than its main one stand at the "
      "end, beside algorithms that ran with the same recipe where there are any; no count and no "
      "picture has them.",
      kSingleSourceAlgorithms, kUnsettledMark);
  table.columns = {{"Benchmark"},          {"Hybrid"},  {"Gain", true}, {"Best with one source"},
                   {"Paper's gain", true}, {"Its best"}};
  const std::map<CellName, HybridGain> theirs = ByCell(paper);
  for (const HybridGain& gain : gains) {
    const auto found = theirs.find({gain.benchmark, gain.algorithm});
    const HybridGain* printed = found == theirs.end() ? nullptr : &found->second;
    const std::string mark = gain.settled ? "" : fmt::format(" {}", kUnsettledMark);
    const std::string best = DisplayName(Series{gain.best, gain.best_recipe});
    table.rows.push_back({gain.benchmark, DisplayName(Series{gain.algorithm, gain.recipe}),
                          Signed(gain.gain) + mark, fmt::format("{} (of {})", best, gain.compared),
                          printed != nullptr ? Signed(printed->gain) : kMissing,
                          printed != nullptr ? DisplayName(printed->best) : kMissing});
  }
  return table;
}

}  // namespace

Section GainSection(const Evidence& evidence) {
  const auto ours = HybridGains(evidence.ours, evidence.benchmarks);
  const auto paper = HybridGains(evidence.paper, evidence.benchmarks);
  Section section;
  section.title = "Hybrid gain";
  section.blocks.emplace_back(Paragraph{
      "An algorithm that has a simulator and data should do no worse than the best algorithm that "
      "has one of them. Hybrid gain is its score minus that of the best of TD3, SAC, BC, MOPO, "
      "TD3-BC and IQL on the same benchmark, in points. The best of several scores is flattered by "
      "chance: among seven algorithms that are equally good, one is above the best of the other "
      "six in one benchmark of seven; of the paper's, which has no BC, in one of six. Algorithms "
      "differ in their updates (see the opening): beside one with more of them, a hybrid that "
      "still rises may yet gain. Runs that learn nothing settle first: gains that rest on settled "
      "scores alone are the lower ones while many runs still learn."});
  List counts{CountsOf(paper, "Paper,")};
  std::ranges::copy(CountsOf(ours, "Ours,"), std::back_inserter(counts.items));
  std::ranges::copy(CountsOfBoth(ours, paper), std::back_inserter(counts.items));
  section.blocks.emplace_back(std::move(counts));
  section.blocks.emplace_back(GainPicture(ours, paper, evidence.benchmarks));
  if (ours.empty()) return section;
  std::vector<HybridGain> all = ours;
  std::ranges::copy(GainsOfOtherRecipes(evidence), std::back_inserter(all));
  section.blocks.emplace_back(GainsTable(all, paper));
  return section;
}

}  // namespace b4mrl
