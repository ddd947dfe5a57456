// What ran with which budget, version and processor, and what a reader must beware of.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>

#include "benchmarks/pages/entries.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {

Section OriginSection(const Evidence& evidence) {
  struct Sum {
    size_t runs = 0;
    double core_hours = 0;
  };
  using Key = std::tuple<std::string, std::string, std::string, std::string, std::string>;
  std::map<Key, Sum> groups;
  for (const ScoredRun& run : evidence.table.runs()) {
    if (!run.fills_a_cell) continue;
    Sum& sum = groups[{run.budget, run.precision, run.version, run.processor, run.kernel}];
    ++sum.runs;
    sum.core_hours += run.core_hours;
  }
  Table table;
  table.id = "origin";
  table.title = "What ran where.";
  table.caption =
      "The budget is the one that a run was last continued with; the program's commit stands in "
      "each result. What the names of the project's budgets and recipes stand for says "
      "benchmarks/budgets.toml.";
  table.columns = {{"Budget"},      {"Precision"},  {"Version"},         {"Processor"},
                   {"BLAS kernel"}, {"Runs", true}, {"Core-hours", true}};
  for (const auto& [key, sum] : groups) {
    const auto& [budget, precision, version, processor, kernel] = key;
    const auto shown = [](const std::string& text) { return text.empty() ? kMissing : text; };
    table.rows.push_back({shown(budget), shown(precision), shown(version), shown(processor),
                          shown(kernel), fmt::format("{}", sum.runs),
                          fmt::format("{:.1f}", sum.core_hours)});
  }
  const auto of_changed_programs = std::ranges::count_if(
      evidence.table.runs(),
      [](const ScoredRun& run) { return run.fills_a_cell && run.commit.ends_with("-dirty"); });
  if (of_changed_programs > 0) {
    table.caption += fmt::format(
        " Of {} of them it ends in -dirty: their programs held changes that were not committed.",
        of_changed_programs);
  }
  Section section;
  section.title = "Where the results come from";
  section.blocks.emplace_back(std::move(table));
  if (!evidence.table.notes().empty()) section.blocks.emplace_back(List{evidence.table.notes()});
  return section;
}

}  // namespace b4mrl
