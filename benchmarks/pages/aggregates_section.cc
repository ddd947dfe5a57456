// What the algorithms are worth over many benchmarks.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "benchmarks/evidence/aggregates.h"
#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {
namespace {

Table EstimatesTable(const Aggregates& aggregates) {
  Table table;
  table.id = "aggregates";
  table.title = "Interquartile mean, median and mean of the scores.";
  table.caption =
      "Each cell counts once, however many benchmarks its runs fill: an algorithm that uses no "
      "dataset has one for each simulator, one that uses no simulator one for each dataset. "
      "Interquartile means and their intervals stand where there are eight cells or more: of fewer "
      "there is next to nothing to cut off. Intervals of 95%: percentile bootstrap, 50,000 "
      "resamples of cells and of the runs inside them. In the interquartile mean each cell stands "
      "by the mean of its runs where an algorithm's cells differ in their number of seeds.";
  table.columns = {{"Algorithm"},
                   {"Cells", true},
                   {"Interquartile mean", true},
                   {"95% interval", true},
                   {"Median", true},
                   {"Mean", true},
                   {"Interquartile mean of the paper's means", true}};
  for (const Aggregate& each : aggregates.series) {
    const bool is_enough = each.cells >= kLeastBenchmarks;
    table.rows.push_back({DisplayName(each.series), fmt::format("{}", each.cells),
                          is_enough ? Fixed(each.iqm, 1) : kMissing,
                          IntervalEntry(each.iqm_interval, 1), Fixed(each.median, 1),
                          Fixed(each.mean, 1), is_enough ? Fixed(each.paper_iqm, 1) : kMissing});
  }
  return table;
}

Table ImprovementsTable(const Aggregates& aggregates) {
  Table table;
  table.id = "improvement";
  table.title = "Probability of improvement.";
  table.caption =
      "How likely a run of the first algorithm scores higher than a run of the second on the same "
      "benchmark, equal scores counted half: the mean over benchmarks of its share among all pairs "
      "of their runs. Each pair of cells counts once, however many benchmarks both fill.";
  table.columns = {
      {"Algorithm"}, {"Over"}, {"Probability", true}, {"Pairs", true}, {"95% interval", true}};
  for (const Improvement& each : aggregates.improvements) {
    table.rows.push_back({DisplayName(each.better), DisplayName(each.worse),
                          Fixed(each.probability, 2), fmt::format("{}", each.pairs),
                          IntervalEntry(each.interval, 2)});
  }
  return table;
}

// Series that are not compared: " Left out, ...: HyMOPO (short)."; "" if there are none.
std::string LeftOut(const ScoreTable& table, const Aggregates& aggregates) {
  std::vector<std::string> names;
  for (const Series& series : table.series()) {
    if (std::ranges::count(aggregates.series, series, &Aggregate::series) > 0) continue;
    names.push_back(DisplayName(series));
  }
  if (names.empty()) return "";
  return fmt::format(" Left out, for with any of them fewer benchmarks would have all: {}.",
                     fmt::join(names, ", "));
}

}  // namespace

Section AggregatesSection(const Evidence& evidence) {
  Section section;
  section.title = "Over many benchmarks";
  const auto aggregates = AggregatesOf(evidence.table, evidence.paper);
  if (!aggregates) {
    section.blocks.emplace_back(Paragraph{fmt::format(
        "No algorithms with settled scores on {} of the same benchmarks were found, so nothing is "
        "said about them on the whole.",
        kLeastBenchmarks)});
    return section;
  }
  std::string names;
  for (const Benchmark* benchmark : aggregates->benchmarks) {
    names += (names.empty() ? "" : ", ") + benchmark->name;
  }
  section.blocks.emplace_back(Paragraph{fmt::format(
      "Algorithms with settled scores on the same {} benchmarks, those that are filled by the same "
      "runs of all of them counted once: {}.{} Updates of the runs as above: ours differ between "
      "algorithms. Runs that learn nothing settle first, so while others still learn these figures "
      "are too low.",
      aggregates->benchmarks.size(), names, LeftOut(evidence.table, *aggregates))});
  section.blocks.emplace_back(EstimatesTable(*aggregates));
  section.blocks.emplace_back(ImprovementsTable(*aggregates));
  section.blocks.emplace_back(ProfilesPicture(evidence, *aggregates));
  return section;
}

}  // namespace b4mrl
