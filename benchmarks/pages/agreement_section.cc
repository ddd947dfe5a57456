// How far our scores agree with the paper's.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/evidence/agreement.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

constexpr double kExplainedPoints = 15;

void AddRows(const std::string& which, const PaperAgreement& agreement, Table* table) {
  const auto add = [&](const char* figure, const Agreement& each) {
    table->rows.push_back({which, figure, fmt::format("{}", each.count), Fixed(each.ours, 2),
                           Fixed(each.floor, 2), Fixed(each.ceiling, 2)});
  };
  add("scores (Spearman)", agreement.scores);
  add("effects of flaws (Spearman)", agreement.effects);
  add("algorithms inside a benchmark (mean Kendall)", agreement.rankings);
}

Table RanksTable(const Evidence& evidence) {
  Table table;
  table.id = "agreement";
  table.title = "Rank correlations with the paper.";
  table.caption =
      "Each run counts once, however many benchmarks it fills, and so does each ranking: of "
      "benchmarks that hold the same runs, or some of another's, one counts. An effect is the "
      "score minus that "
      "of the same algorithm and dataset with clean data and the gravity error alone. Floor: a "
      "table that knows algorithm and dataset alone, as the means of the paper's cells (of SAC and "
      "TD3, which use no dataset, over all of them). Ceiling: "
      "the paper's own numbers with another seed, drawn from their means and deviations (mean of "
      "200).";
  table.columns = {{"Cells"},      {"Figure"},      {"n", true},
                   {"Ours", true}, {"Floor", true}, {"Ceiling", true}};
  const auto compare = [&](const CellScores& ours, AgreementOptions options) {
    return AgreementWith(evidence.paper, ours, evidence.benchmarks, options);
  };
  AddRows("settled", compare(evidence.ours, {}), &table);
  AddRows("settled, without H2O, TD3 and SAC",
          compare(evidence.ours, {.without = {"h2o", "td3", "sac"}}), &table);
  AddRows("settled, without MOPO and HyMOPO",
          compare(evidence.ours, {.without = {"mopo", "hymopo"}}), &table);
  AddRows("all", compare(evidence.ours, {.settled_only = false}), &table);
  AddRows("the paper beside itself", compare(evidence.paper, {}), &table);
  return table;
}

Table PairsTable(const Evidence& evidence) {
  Table table;
  table.id = "pairs";
  table.title = "Algorithms that ours order otherwise than the paper's.";
  table.caption =
      "Of the rankings behind Kendall's figure of the settled cells: those that hold both "
      "algorithms, those in which the two are turned over, and how many different pairs of runs "
      "that are. A run without a dataset, or without a simulator, stands in many rankings, so one "
      "difference between two runs may turn over many.";
  table.columns = {{"Algorithm"},
                   {"Beside"},
                   {"Rankings", true},
                   {"Turned over", true},
                   {"Pairs of runs", true}};
  std::vector<PairOrder> pairs =
      AgreementWith(evidence.paper, evidence.ours, evidence.benchmarks, {}).pairs;
  std::erase_if(pairs, [](const PairOrder& pair) { return pair.turned == 0; });
  std::ranges::stable_sort(pairs, std::ranges::greater(), &PairOrder::turned);
  for (const PairOrder& pair : pairs) {
    table.rows.push_back({DisplayName(pair.one), DisplayName(pair.other),
                          fmt::format("{}", pair.rankings), fmt::format("{}", pair.turned),
                          fmt::format("{}", pair.runs)});
  }
  return table;
}

}  // namespace

Section AgreementSection(const Evidence& evidence) {
  Section section;
  section.title = "Agreement with the paper";
  section.blocks.emplace_back(RanksTable(evidence));
  Table pairs = PairsTable(evidence);
  if (!pairs.rows.empty()) section.blocks.emplace_back(std::move(pairs));
  section.blocks.emplace_back(BesideThePaperPicture(evidence));
  const auto deviations =
      Deviations(evidence.paper, evidence.ours, evidence.benchmarks, kExplainedPoints);
  if (deviations.empty()) return section;
  Table table;
  table.id = "deviations";
  table.title =
      fmt::format("Cells that differ from the paper's by more than {} points.", kExplainedPoints);
  table.caption = fmt::format(
      "A run that fills several cells stands once. {}: the score still moves, so longer training "
      "is the first thing to try. A doubling adds: the points by which each doubling of the "
      "updates raises the score (median slope over the logarithm of the updates, second half of "
      "the run). A score that has settled, by the last two fifths of its run, may still rise by "
      "four points a doubling.",
      kUnsettledMark);
  table.columns = {{"Benchmark"},   {"Algorithm"}, {"Ours", true}, {"A doubling adds", true},
                   {"Paper", true}, {"Why"}};
  for (const Deviation& each : deviations) {
    const auto reason = evidence.explanations.find({each.benchmark, each.algorithm});
    const bool is_known = reason != evidence.explanations.end();
    const auto& gain = each.ours.gain_per_doubling;
    table.rows.push_back({each.benchmark, DisplayName(each.algorithm), ScoreEntry(each.ours),
                          gain ? Signed(*gain) : kMissing, Fixed(each.paper, 1),
                          is_known ? reason->second : "unexplained"});
  }
  section.blocks.emplace_back(std::move(table));
  return section;
}

}  // namespace b4mrl
