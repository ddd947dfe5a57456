// How far our scores agree with the paper's.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/evidence/agreement.h"
#include "benchmarks/evidence/differences.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

constexpr double kExplainedPoints = 15;

void AddRows(const std::string& which, const PaperAgreement& agreement, Table* table) {
  const auto add = [&](const char* figure, const Agreement& each) {
    table->rows.push_back({which, figure, fmt::format("{}", each.count), Fixed(each.ours, 2),
                           IntervalEntry(each.interval, 2), Fixed(each.floor, 2),
                           Fixed(each.ceiling, 2)});
  };
  add("scores (Spearman)", agreement.scores);
  add("effects of flaws (Spearman)", agreement.effects);
  add("algorithms inside a benchmark (mean Kendall)", agreement.rankings);
  add("of them, pairs that the paper separates", agreement.separated);
}

// Ours, with the paper's scores of one algorithm in the place of ours.
CellScores WithThePapers(const Evidence& evidence, const std::string& algorithm) {
  CellScores scores = evidence.ours;
  for (auto& [name, score] : scores) {
    const CellScore* theirs = Find(evidence.paper, name.first, name.second);
    if (name.second == algorithm && theirs != nullptr) score.mean = theirs->mean;
  }
  return scores;
}

CellScores ByLastFifths(CellScores scores) {
  for (auto& [name, score] : scores) score.mean = score.last_fifth.value_or(score.mean);
  return scores;
}

// `settled`: the agreement of the settled cells.
Table RanksTable(const Evidence& evidence, const PaperAgreement& settled) {
  Table table;
  table.id = "agreement";
  table.title = "Rank correlations with the paper.";
  table.caption =
      "Each run counts once, however many benchmarks it fills, and so does each ranking: of "
      "benchmarks that hold the same runs, or some of another's, one counts. An effect is the "
      "score minus that of the same algorithm and dataset with clean data and the gravity error "
      "alone. Floor: a table that knows algorithm and dataset alone, as the means of the "
      "paper's runs, the compared one among them (of SAC and TD3, which use no dataset, over "
      "all of them). Ceiling: the paper's own numbers with another seed, drawn from their means "
      "and deviations (mean of 200). Separated: the paper's means are more than two standard "
      "errors of their difference apart. By last fifths: the mean score of a run's last fifth "
      "stands for that of its last evaluation. With a recipe: where an algorithm has run with "
      "it, its scores by that stand for the others. By the paper: its scores stand for ours of "
      "that algorithm. The intervals are percentile bootstraps with 2,000 resamples of what is "
      "counted: they tell what other cells could give, not what other seeds would, and are too "
      "narrow where rankings share runs.";
  table.columns = {
      {"Cells"},       {"Figure"},       {"n", true}, {"Ours", true}, {"95% interval", true},
      {"Floor", true}, {"Ceiling", true}};
  const auto compare = [&](const CellScores& ours, AgreementOptions options) {
    return AgreementWith(evidence.paper, ours, evidence.benchmarks, options);
  };
  AddRows("settled", settled, &table);
  AddRows("settled, without H2O, TD3 and SAC",
          compare(evidence.ours, {.without = {"h2o", "td3", "sac"}}), &table);
  AddRows("settled, without MOPO and HyMOPO",
          compare(evidence.ours, {.without = {"mopo", "hymopo"}}), &table);
  AddRows("settled, by last fifths", compare(ByLastFifths(evidence.ours), {}), &table);
  for (const std::string& recipe : OtherRecipes(evidence.table)) {
    const CellScores scores = OwnScores(evidence.table, evidence.deviations, recipe);
    AddRows(fmt::format("settled, with the recipe {}", recipe), compare(scores, {}), &table);
  }
  for (const char* algorithm : {"sac", "mopo"}) {
    const std::string which = fmt::format("settled, {} by the paper", DisplayName(algorithm));
    AddRows(which, compare(WithThePapers(evidence, algorithm), {}), &table);
  }
  AddRows("all", compare(evidence.ours, {.settled_only = false}), &table);
  AddRows("all, by last fifths", compare(ByLastFifths(evidence.ours), {.settled_only = false}),
          &table);
  AddRows("the paper beside itself", compare(evidence.paper, {}), &table);
  return table;
}

Table PairsTable(std::vector<PairOrder> pairs) {
  Table table;
  table.id = "pairs";
  table.title = "Algorithms that ours order otherwise than the paper's.";
  table.caption =
      "Of the rankings behind Kendall's figure of the settled cells: those that hold both "
      "algorithms, those in which the two are turned over, and the different pairs of runs behind "
      "them, in all and turned over. A run without a dataset, or without a simulator, stands in "
      "many rankings, so one "
      "difference between two runs may turn over many.";
  table.columns = {{"Algorithm"},           {"Beside"},
                   {"Rankings", true},      {"Turned over", true},
                   {"Pairs of runs", true}, {"Of them turned over", true}};
  std::erase_if(pairs, [](const PairOrder& pair) { return pair.turned == 0; });
  std::ranges::stable_sort(pairs, std::ranges::greater(), &PairOrder::turned);
  for (const PairOrder& pair : pairs) {
    table.rows.push_back({DisplayName(pair.one), DisplayName(pair.other),
                          fmt::format("{}", pair.rankings), fmt::format("{}", pair.turned),
                          fmt::format("{}", pair.runs), fmt::format("{}", pair.turned_runs)});
  }
  return table;
}

Table LevelsTable(const Evidence& evidence) {
  Table table;
  table.id = "levels";
  table.title = "How high our scores are beside the paper's.";
  table.caption =
      "Rank correlations do not see a difference that all cells have. Each run counts once; "
      "differences are means of ours minus the paper's, in points.";
  table.columns = {{"Algorithm"},        {"Runs", true},         {"Below the paper's", true},
                   {"Difference", true}, {"Settled runs", true}, {"Difference", true}};
  for (const ScoreLevel& level : ScoreLevels(evidence.paper, evidence.ours, evidence.benchmarks)) {
    table.rows.push_back({DisplayName(level.algorithm), fmt::format("{}", level.runs),
                          fmt::format("{}", level.lower), Signed(level.difference),
                          fmt::format("{}", level.settled_runs),
                          level.settled_runs > 0 ? Signed(level.settled_difference) : kMissing});
  }
  return table;
}

Table DeviationsTable(const Evidence& evidence, const std::vector<Deviation>& deviations) {
  Table table;
  table.id = "deviations";
  table.title =
      fmt::format("Cells that differ from the paper's by more than {} points.", kExplainedPoints);
  table.caption = fmt::format(
      "A run that fills several cells stands once. {}: the score still moves, so longer training "
      "is the first thing to try. Last fifth: the mean score over the last fifth of the run. A "
      "doubling adds: the points by which each doubling of the updates raises the score (median "
      "slope over the logarithm of the updates, second half of the run). A score that has settled, "
      "by the last two fifths of its run, may still rise by five points a doubling.",
      kUnsettledMark);
  table.columns = {{"Benchmark"},
                   {"Algorithm"},
                   {"Ours", true},
                   {"Last fifth", true},
                   {"A doubling adds", true},
                   {"Paper", true},
                   {"Why"}};
  for (const Deviation& each : deviations) {
    const auto reason = evidence.explanations.find({each.benchmark, each.algorithm});
    const bool is_known = reason != evidence.explanations.end();
    table.rows.push_back({each.benchmark, DisplayName(each.algorithm), ScoreEntry(each.ours),
                          Fixed(each.ours.last_fifth, 1), GainEntry(each.ours),
                          Fixed(each.paper, 1), is_known ? reason->second : "unexplained"});
  }
  return table;
}

}  // namespace

Section AgreementSection(const Evidence& evidence) {
  Section section;
  section.title = "Agreement with the paper";
  const PaperAgreement settled =
      AgreementWith(evidence.paper, evidence.ours, evidence.benchmarks, {});
  section.blocks.emplace_back(RanksTable(evidence, settled));
  Table pairs = PairsTable(settled.pairs);
  if (!pairs.rows.empty()) section.blocks.emplace_back(std::move(pairs));
  Table levels = LevelsTable(evidence);
  if (!levels.rows.empty()) section.blocks.emplace_back(std::move(levels));
  section.blocks.emplace_back(BesideThePaperPicture(evidence));
  const auto deviations =
      Deviations(evidence.paper, evidence.ours, evidence.benchmarks, kExplainedPoints);
  if (!deviations.empty()) section.blocks.emplace_back(DeviationsTable(evidence, deviations));
  return section;
}

}  // namespace b4mrl
