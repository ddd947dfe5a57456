// How far our scores agree with the paper's.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/evidence/agreement.h"
#include "benchmarks/evidence/differences.h"
#include "benchmarks/evidence/stand_ins.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

constexpr double kExplainedPoints = 15;

// The figures of an agreement, in the order in which tables have them.
struct RankFigure {
  const char* name;
  Agreement PaperAgreement::*of;
};
constexpr RankFigure kFigures[] = {
    {"scores (Spearman)", &PaperAgreement::scores},
    {"effects of flaws (Spearman)", &PaperAgreement::effects},
    {"algorithms inside a benchmark (mean Kendall)", &PaperAgreement::rankings},
    {"of them, pairs that the paper separates", &PaperAgreement::separated},
    {"pairs of runs, each once (Kendall)", &PaperAgreement::run_pairs},
    {"of them, pairs apart in both", &PaperAgreement::apart},
};

// Ours, with the paper's scores of one algorithm in the place of ours.
CellScores WithThePapers(const Evidence& evidence, const std::string& algorithm) {
  CellScores scores = evidence.ours;
  for (auto& [name, score] : scores) {
    const CellScore* theirs = Find(evidence.paper, name.first, name.second);
    if (name.second != algorithm || theirs == nullptr) continue;
    score.mean = theirs->mean;
    score.standard_error = theirs->standard_error;
    score.degrees = theirs->degrees;
    score.updates = theirs->updates;
    score.earlier.clear();  // the paper has no scores after fewer updates
  }
  return scores;
}

CellScore ByLastFifth(CellScore score) {
  score.mean = score.last_fifth.value_or(score.mean);
  std::ranges::transform(score.earlier, score.earlier.begin(), ByLastFifth);
  return score;
}

CellScores ByLastFifths(CellScores scores) {
  for (auto& [name, score] : scores) score = ByLastFifth(std::move(score));
  return scores;
}

CellScores SurelySettled(CellScores scores) {
  std::erase_if(scores, [](const auto& each) { return !each.second.surely_settled; });
  return scores;
}

// Those that have settled in both.
CellScores SettledIn(const CellScores& scores, const CellScores& others) {
  CellScores settled;
  for (const auto& [name, score] : scores) {
    const CellScore* other = Find(others, name.first, name.second);
    if (score.settled && other != nullptr && other->settled) settled[name] = score;
  }
  return settled;
}

// In the field's order.
std::vector<std::string> AlgorithmsIn(const std::vector<PairOrder>& pairs) {
  std::set<std::string> names;
  for (const PairOrder& pair : pairs) names.insert({pair.one, pair.other});
  std::vector<std::string> ordered(names.begin(), names.end());
  std::ranges::stable_sort(ordered, {}, OrderOf);
  return ordered;
}

Table RanksTable(const PaperAgreement& settled) {
  Table table;
  table.id = "agreement";
  table.title = "Rank correlations with the paper, of the settled cells.";
  table.caption =
      "Scores and effects: each run counts once, however many benchmarks it fills. Algorithms "
      "inside a benchmark: of benchmarks that hold the same runs, or some of another's, one "
      "counts, but a run without a dataset, or without a simulator, still stands in many. Pairs of "
      "runs: of all these rankings, each pair once. An effect is the score minus that of the same "
      "algorithm, recipe and dataset with clean data and the gravity error alone, of ours after "
      "equally many updates, or, where the longer run was not evaluated then, at its last "
      "evaluation before that. Separated: the paper's means are more than two standard errors of "
      "their difference apart. Apart in both: the paper's and ours are, by the error of each cell "
      "(as for the claims; a cell of fewer than three seeds borrows it from the paper's "
      "deviations), so that no other seed is likely to order them otherwise. Floor: a table that "
      "knows algorithm and dataset alone, as the means of the paper's runs, the compared one among "
      "them (of SAC and TD3, which use no dataset, over all of them), so that where there is no "
      "other run the floor has its score; it has no effects, so their floor is 0 by its nature. "
      "Ceiling: the paper's own numbers with another seed, drawn from their means and deviations, "
      "these taken as divided by the number of seeds, with the error of a mean of three (mean of "
      "200). The intervals are percentile bootstraps with 2,000 resamples of runs, of effects, or, "
      "for rankings and pairs, of the datasets, each corruption of one for itself: they tell what "
      "other cells could give, not what other seeds would.";
  table.columns = {{"Figure"},      {"n", true},      {"Ours", true}, {"95% interval", true},
                   {"Floor", true}, {"Ceiling", true}};
  for (const RankFigure& figure : kFigures) {
    const Agreement& each = settled.*figure.of;
    table.rows.push_back({figure.name, fmt::format("{}", each.count), Fixed(each.ours, 2),
                          IntervalEntry(each.interval, 2), Fixed(each.floor, 2),
                          Fixed(each.ceiling, 2)});
  }
  return table;
}

// The same figures of other cells, and of other scores in their place.
Table OtherRanksTable(const Evidence& evidence, const PaperAgreement& settled) {
  Table table;
  table.id = "agreement-otherwise";
  table.title = "The same of other cells, and with other scores.";
  table.caption =
      "In brackets n and the floor, which change with the cells. Surely settled: within the 1.5 "
      "points also with one standard error of the difference between the last two fifths on top, "
      "by how much the evaluations in each vary. By last fifths: the mean score of a run's last "
      "fifth stands for that of its last evaluation. With one dataset for another: the scores on a "
      "dataset of ours that is nearer to D4RL's stand for those on the one of its name, and cells "
      "that have none are left out. With a recipe: where an algorithm has run with it, its scores "
      "by that stand for the others; they are compared on the cells that have settled with both; "
      "an effect needs both scores by one recipe, so n can differ. By the paper: its scores stand "
      "for ours of that algorithm. All: also cells that have not settled. The paper with another "
      "seed: the ceiling of all its cells.";
  table.columns = {{"Cells"}};
  for (const RankFigure& figure : kFigures) table.columns.push_back({figure.name, true});
  const auto add = [&](const std::string& which, const PaperAgreement& agreement) {
    std::vector<std::string> row = {which};
    for (const RankFigure& figure : kFigures) {
      const Agreement& each = agreement.*figure.of;
      row.push_back(
          fmt::format("{} ({}; {})", Fixed(each.ours, 2), each.count, Fixed(each.floor, 2)));
    }
    table.rows.push_back(std::move(row));
  };
  const auto compare = [&](const CellScores& ours, const AgreementOptions& options) {
    return AgreementWith(evidence.paper, ours, evidence.benchmarks, options);
  };
  add("settled", settled);
  add("surely settled", compare(SurelySettled(evidence.ours), {}));
  add("without H2O, TD3 and SAC", compare(evidence.ours, {.without = {"h2o", "td3", "sac"}}));
  add("without MOPO and HyMOPO", compare(evidence.ours, {.without = {"mopo", "hymopo"}}));
  add("by last fifths", compare(ByLastFifths(evidence.ours), {}));
  for (const StandIn& each : kStandIns) {
    add(fmt::format("with {} for {}", each.by, each.dataset),
        compare(WithStandIn(evidence.ours, evidence.benchmarks, each), {}));
  }
  for (const std::string& recipe : OtherRecipes(evidence.table)) {
    const CellScores scores = OwnScores(evidence.table, evidence.deviations, recipe);
    add(fmt::format("settled also with the recipe {}", recipe),
        compare(SettledIn(evidence.ours, scores), {}));
    add(fmt::format("the same, by the recipe {}", recipe),
        compare(SettledIn(scores, evidence.ours), {}));
  }
  for (const std::string& algorithm : AlgorithmsIn(settled.pairs)) {
    add(fmt::format("{} by the paper", DisplayName(algorithm)),
        compare(WithThePapers(evidence, algorithm), {}));
  }
  add("all", compare(evidence.ours, {.settled_only = false}));
  add("all, by last fifths", compare(ByLastFifths(evidence.ours), {.settled_only = false}));
  const PaperAgreement itself = compare(evidence.paper, {});
  add("the paper beside itself", itself);
  std::vector<std::string> ceilings = {"the paper with another seed"};
  for (const RankFigure& figure : kFigures) {
    ceilings.push_back(Fixed((itself.*figure.of).ceiling, 2));
  }
  table.rows.push_back(std::move(ceilings));
  return table;
}

Table PairsTable(const std::vector<PairOrder>& pairs) {
  Table table;
  table.id = "pairs";
  table.title = "Algorithms that ours order otherwise than the paper's.";
  table.caption =
      "Of the rankings behind Kendall's figure of the settled cells: those that hold both "
      "algorithms; the different pairs of runs behind them; of these, those that the paper "
      "separates, and of them, those that lie apart in ours, too; behind each, how many are "
      "reversed. A run without a dataset, or without a simulator, stands in many rankings, so one "
      "difference between two runs may reverse many.";
  table.columns = {{"Algorithm"},           {"Beside"},
                   {"Rankings", true},      {"Rankings reversed", true},
                   {"Pairs of runs", true}, {"Pairs reversed", true},
                   {"Separated", true},     {"Separated and reversed", true},
                   {"Apart in both", true}, {"Apart and reversed", true}};
  constexpr size_t PairOrder::*kCounts[] = {&PairOrder::rankings,  &PairOrder::reversed,
                                            &PairOrder::runs,      &PairOrder::reversed_runs,
                                            &PairOrder::separated, &PairOrder::reversed_separated,
                                            &PairOrder::apart,     &PairOrder::reversed_apart};
  PairOrder all = {"all", ""};
  for (const PairOrder& pair : pairs) {
    for (const auto count : kCounts) all.*count += pair.*count;
  }
  std::vector<PairOrder> rows = pairs;
  std::ranges::stable_sort(rows, std::ranges::greater(), &PairOrder::reversed);
  if (!rows.empty()) rows.push_back(all);
  for (const PairOrder& pair : rows) {
    std::vector<std::string> row = {DisplayName(pair.one), DisplayName(pair.other)};
    for (const auto count : kCounts) row.push_back(fmt::format("{}", pair.*count));
    table.rows.push_back(std::move(row));
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
                   {"Difference", true}, {"Settled runs", true}, {"Difference, settled", true}};
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
      "A run that fills several cells stands once. {}: the score still rises, so longer training "
      "is the first thing to try; {}: it falls. Last fifth: the mean score over the last fifth of "
      "the run. A doubling adds: the points by which each doubling of the updates raises the score "
      "(median slope over the logarithm of the updates, second half of the run). A score that has "
      "settled, by the last two fifths of its run, may still rise by four points a doubling where "
      "its curve is straight, and by more where it is not.",
      kRisingMark, kFallingMark);
  table.columns = {{"Benchmark"},
                   {"Algorithm"},
                   {"Ours", true},
                   {"Last fifth", true},
                   {"A doubling adds", true},
                   {"Paper", true},
                   {"Why"}};
  for (const Deviation& each : deviations) {
    const auto reason = evidence.explanations.find({each.benchmark, each.algorithm});
    const bool is_known =
        reason != evidence.explanations.end() && reason->second.score == PlainScoreEntry(each.ours);
    table.rows.push_back({each.benchmark, DisplayName(each.algorithm), ScoreEntry(each.ours),
                          Fixed(each.ours.last_fifth, 1), GainEntry(each.ours),
                          Fixed(each.paper, 1), is_known ? reason->second.why : "unexplained"});
  }
  return table;
}

}  // namespace

Section AgreementSection(const Evidence& evidence) {
  Section section;
  section.title = "Agreement with the paper";
  const PaperAgreement settled =
      AgreementWith(evidence.paper, evidence.ours, evidence.benchmarks, {});
  section.blocks.emplace_back(RanksTable(settled));
  section.blocks.emplace_back(OtherRanksTable(evidence, settled));
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
