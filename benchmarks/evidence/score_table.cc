#include "benchmarks/evidence/score_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>

#include "algorithms/datasets/dataset_recipes.h"
#include "benchmarks/records/copied_seeds.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/plain_text.h"
#include "benchmarks/records/result_file.h"
#include "data/files/folder_listing.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

// Leaves out results that are another seed's under another number: a mean over them would be a mean
// over fewer seeds than it says, without an error.
void LeaveOutCopies(const std::vector<nlohmann::ordered_json>& marks, std::vector<ScoredRun>* runs,
                    std::vector<std::string>* notes) {
  std::vector<std::string> files;
  for (const ScoredRun& run : *runs) files.push_back(run.file);
  const auto faults = CopiedSeeds(marks, files);
  std::set<std::string> copies;
  for (size_t i = 0; i < files.size(); ++i) {
    if (faults[i].empty()) continue;
    copies.insert(files[i]);
    notes->push_back(fmt::format("{} was left out: {}", files[i], faults[i].front()));
  }
  std::erase_if(*runs, [&](const ScoredRun& run) { return copies.contains(run.file); });
}

// The most updates after which all of the cell's runs were evaluated, but for those that diverged
// before; nothing if there are none.
std::optional<uint64_t> EqualUpdates(const Cell& cell) {
  uint64_t end = cell.LeastUpdates();
  for (bool falls = true; falls;) {
    falls = false;
    for (const ScoredRun* run : cell.runs) {
      if (run->diverged && run->updates <= end) continue;
      const auto last = run->LastEvaluation(end);
      if (!last) return std::nullopt;
      if (*last == end) continue;
      end = *last;
      falls = true;
    }
  }
  return end;
}

std::optional<double> MovementOf(const ScoredRun& run) { return run.fifths.Movement(); }
std::optional<double> ToleranceOf(const ScoredRun& run) { return run.fifths.tolerance; }

}  // namespace

std::vector<double> Cell::Scores() const {
  std::vector<double> scores;
  for (const ScoredRun* run : runs) scores.push_back(run->score);
  return scores;
}

double Cell::Mean() const { return MeanAndStdOf(Scores()).mean; }

double Cell::Deviation() const { return MeanAndStdOf(Scores()).std; }

std::optional<double> Cell::MeanOf(
    const std::function<std::optional<double>(const ScoredRun&)>& value) const {
  double sum = 0;
  for (const ScoredRun* run : runs) {
    const std::optional<double> of_run = value(*run);
    if (!of_run) return std::nullopt;
    sum += *of_run;
  }
  return sum / static_cast<double>(runs.size());
}

bool Cell::Learns() const {
  return std::ranges::any_of(runs, [](const ScoredRun* run) {
    return !run->learns_until || run->updates < *run->learns_until;
  });
}

bool Cell::IsSurelySettled() const {
  if (!IsSettled()) return false;
  if (!Learns()) return true;
  const auto squared_error = MeanOf([](const ScoredRun& run) -> std::optional<double> {
    if (!run.fifths.movement_error) return std::nullopt;
    return *run.fifths.movement_error * *run.fifths.movement_error;
  });
  if (!squared_error) return false;
  const double error = std::sqrt(*squared_error / static_cast<double>(runs.size()));
  return std::abs(*MeanOf(MovementOf)) + error <= *MeanOf(ToleranceOf);
}

Course Cell::CourseOfScore() const {
  if (!std::ranges::all_of(runs, &ScoredRun::ended)) return Course::kRising;
  if (!Learns()) return Course::kSettled;
  const auto movement = MeanOf(MovementOf);
  if (!movement) return Course::kUntold;
  if (std::abs(*movement) <= *MeanOf(ToleranceOf)) return Course::kSettled;
  return *movement > 0 ? Course::kRising : Course::kFalling;
}

uint64_t Cell::LeastUpdates() const {
  const auto fewest = std::ranges::min_element(
      runs, {}, [](const ScoredRun* run) { return std::pair(run->diverged, run->updates); });
  return (*fewest)->updates;
}

uint64_t Cell::MostUpdates() const {
  return (*std::ranges::max_element(runs, {}, &ScoredRun::updates))->updates;
}

Result<ScoreTable> ScoreTable::Read(const std::string& folder,
                                    const std::vector<Benchmark>& benchmarks,
                                    const ReadingLimit& limit,
                                    const std::map<std::string, std::string>& main_recipes,
                                    const PublishedDatasets& published) {
  B4MRL_ASSIGN_OR_RETURN(const auto files, FilesIn(FolderOfResults(folder), ".json"));
  if (files.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no results", folder));
  }
  ScoreTable table;
  table.main_recipes_ = main_recipes;
  table.runs_ = std::make_shared<std::vector<ScoredRun>>();
  table.earlier_ = std::make_shared<std::deque<ScoredRun>>();
  std::vector<nlohmann::ordered_json> marks;  // of the runs
  for (const std::string& path : files) {
    const std::string file = WithoutControls(std::filesystem::path(path).filename().string());
    auto json = ReadJsonObject(path);
    if (!json.ok()) {
      table.notes_.push_back(fmt::format("{} was left out: no JSON object can be read", file));
      continue;
    }
    ReplaceControls(&*json);
    auto run = ReadScoredRun(*json, limit, published);
    if (!run.ok()) {
      table.notes_.push_back(fmt::format("{} was left out: {}", file, run.status().message()));
      continue;
    }
    run->file = file;
    table.runs_->push_back(*std::move(run));
    marks.push_back(SeedMarks(*json));
  }
  LeaveOutCopies(marks, table.runs_.get(), &table.notes_);
  table.SortRuns();
  table.UniteCells();
  table.AddCells(benchmarks);
  table.LeaveOutUnfinishedSeeds();
  table.MarkRunsInCells(benchmarks);
  table.left_out_ = table.notes_.size();
  table.NoteDivergedRuns();
  table.ReadSeedsAtEqualUpdates();
  table.NoteMixedRuns();
  return table;
}

void ScoreTable::SortRuns() {
  struct Group {
    size_t runs = 0;
    bool has_ended = false;
    uint64_t updates = 0, rows = 0;
  };
  std::map<std::string, Group> groups;  // by the cell's key
  for (const ScoredRun& run : *runs_) {
    Group& group = groups[run.cell_key];
    ++group.runs;
    group.has_ended |= run.ended;
    group.updates = std::max(group.updates, run.updates);
    group.rows = std::max(group.rows, run.rows);
  }
  std::ranges::stable_sort(*runs_, {}, [&](const ScoredRun& run) {
    const Group& group = groups.at(run.cell_key);
    return std::tuple(runs_->size() - group.runs, !group.has_ended, UINT64_MAX - group.updates,
                      UINT64_MAX - group.rows, run.cell_key, run.seed, !run.ended,
                      UINT64_MAX - run.updates, run.precision != "fp32", run.precision);
  });
}

void ScoreTable::UniteCells() {
  struct Names {
    std::string recipe;  // the first that there is
    std::set<std::string> benchmarks;
  };
  // A learner's scores by itself, and runs on other rows, are no runs of the cell.
  const auto key_of = [](const ScoredRun& run) {
    return std::tuple(run.cell_key, run.series.algorithm, run.series.has_other_data);
  };
  std::map<std::tuple<std::string, std::string, bool>, Names> cells;
  for (const ScoredRun& run : *runs_) {
    Names& names = cells[key_of(run)];
    if (names.recipe.empty()) names.recipe = run.series.recipe;
    names.benchmarks.insert(run.benchmarks.begin(), run.benchmarks.end());
  }
  for (ScoredRun& run : *runs_) {
    const Names& names = cells.at(key_of(run));
    run.series.recipe = names.recipe;
    run.benchmarks.assign(names.benchmarks.begin(), names.benchmarks.end());
  }
}

void ScoreTable::AddCells(const std::vector<Benchmark>& benchmarks) {
  std::map<std::string_view, const Benchmark*> known;
  for (const Benchmark& benchmark : benchmarks) known.emplace(benchmark.name, &benchmark);
  std::set<Series> used;
  std::set<std::string> left_out, of_other_versions;
  for (const ScoredRun& run : *runs_) {
    const std::set<std::string> names(run.benchmarks.begin(), run.benchmarks.end());
    for (const std::string& name : names) {
      const auto benchmark = known.find(name);
      if (benchmark == known.end()) continue;
      if (AreVersionsOfOne(run.dataset, benchmark->second->dataset)) {
        if (of_other_versions.insert(run.file).second) {
          left_out.insert(fmt::format("{} was left out: its dataset is {}, and {} has {}", run.file,
                                      run.dataset, name, benchmark->second->dataset));
        }
        continue;
      }
      Cell& cell = cells_[name][run.series];
      used.insert(run.series);
      const ScoredRun* other = cell.runs.empty() ? nullptr : cell.runs.back();
      if (other == nullptr) {
        cell.runs.push_back(&run);
      } else if (other->cell_key != run.cell_key) {
        left_out.insert(
            fmt::format("{} was left out: {} fills its cell with other hyperparameters, "
                        "perturbations or rows of the dataset",
                        run.file, other->file));
      } else if (other->is_return != run.is_return) {
        left_out.insert(
            fmt::format("{} was left out: of it and {} one has scores, the other returns", run.file,
                        other->file));
      } else if (other->seed == run.seed) {
        left_out.insert(
            fmt::format("{} was left out: {} is of the same cell and seed", run.file, other->file));
      } else {
        cell.runs.push_back(&run);
      }
    }
  }
  notes_.insert(notes_.end(), left_out.begin(), left_out.end());
  for (const Benchmark& benchmark : benchmarks) {
    if (cells_.contains(benchmark.name)) benchmarks_.push_back(&benchmark);
  }
  series_.assign(used.begin(), used.end());
  std::ranges::stable_sort(series_, {}, [](const Series& each) { return OrderOf(each.algorithm); });
}

void ScoreTable::LeaveOutUnfinishedSeeds() {
  std::set<std::string> left_out;
  for (auto& [benchmark, row] : cells_) {
    for (auto& [series, cell] : row) {
      const auto has_finished = [](const ScoredRun* run) { return run->ended && !run->diverged; };
      if (std::ranges::none_of(cell.runs, has_finished)) continue;
      std::erase_if(cell.runs, [&](const ScoredRun* run) {
        if (run->ended) return false;
        left_out.insert(fmt::format(
            "{} was left out: it has not finished, and another seed of its cell has", run->file));
        return true;
      });
    }
  }
  notes_.insert(notes_.end(), left_out.begin(), left_out.end());
}

void ScoreTable::MarkRunsInCells(const std::vector<Benchmark>& benchmarks) {
  std::set<const ScoredRun*> in_cells;
  for (const auto& [benchmark, row] : cells_) {
    for (const auto& [series, cell] : row) in_cells.insert(cell.runs.begin(), cell.runs.end());
  }
  std::set<std::string> known;
  for (const Benchmark& benchmark : benchmarks) known.insert(benchmark.name);
  for (ScoredRun& run : *runs_) {
    run.fills_a_cell = in_cells.contains(&run);
    const auto is_known = [&](const std::string& name) { return known.contains(name); };
    if (std::ranges::any_of(run.benchmarks, is_known)) continue;
    notes_.push_back(fmt::format(
        "{} was left out: it names no benchmark of these suites (--suites for your own)",
        run.file));
  }
}

void ScoreTable::NoteDivergedRuns() {
  for (const ScoredRun& run : *runs_) {
    if (!run.fills_a_cell || !run.diverged) continue;
    notes_.push_back(fmt::format(
        "{} diverged: it counts in its cell as it was after {} updates, its last evaluation",
        run.file, run.updates));
  }
}

void ScoreTable::ReadSeedsAtEqualUpdates() {
  std::map<std::pair<const ScoredRun*, uint64_t>, const ScoredRun*> known;
  for (auto& [benchmark, row] : cells_) {
    for (auto& [series, cell] : row) {
      const std::optional<uint64_t> equal = EqualUpdates(cell);
      const uint64_t least = equal.value_or(cell.LeastUpdates());
      for (const ScoredRun*& run : cell.runs) {
        if (run->updates <= least) continue;
        const auto [entry, is_new] = known.emplace(std::pair(run, least), run);
        if (is_new) {
          std::optional<ScoredRun> earlier = run->At(least);
          if (!earlier) continue;  // its first evaluation came later
          notes_.push_back(fmt::format(
              "{} has gone on to {} updates and is read at {}, {}", run->file, run->updates,
              earlier->updates,
              equal ? "which all seeds of its cell have"
                    : fmt::format("its last evaluation within the {} of the shortest seed of its "
                                  "cell, as the seeds were evaluated after no equal updates",
                                  least)));
          earlier_->push_back(*std::move(earlier));
          entry->second = &earlier_->back();
        }
        run = entry->second;
      }
    }
  }
}

void ScoreTable::NoteMixedRuns() {
  std::set<std::string> noted;
  for (const Benchmark* benchmark : benchmarks_) {
    for (const auto& [series, cell] : cells_.at(benchmark->name)) {
      std::set<std::string> machines, precisions;
      std::set<uint64_t> updates;
      for (const ScoredRun* run : cell.runs) {
        machines.insert(run->processor + ", " + run->kernel);
        precisions.insert(run->precision);
        updates.insert(run->updates);
      }
      if (machines.size() <= 1 && precisions.size() <= 1 && updates.size() <= 1) continue;
      std::string what = updates.size() > 1      ? "numbers of updates"
                         : precisions.size() > 1 ? "precisions"
                                                 : "processors or BLAS kernels";
      if (!noted.insert(cell.runs.front()->cell_key).second) continue;
      notes_.push_back(fmt::format("{} on {} is a mean over several {}", DisplayName(series),
                                   benchmark->name, what));
    }
  }
}

const Cell* ScoreTable::Find(const std::string& benchmark, const Series& series) const {
  const auto row = cells_.find(benchmark);
  if (row == cells_.end()) return nullptr;
  const auto cell = row->second.find(series);
  return cell == row->second.end() ? nullptr : &cell->second;
}

std::optional<Series> ScoreTable::MainSeries(const std::string& algorithm) const {
  const auto recipe = main_recipes_.find(algorithm);
  if (recipe != main_recipes_.end()) {
    const Series asked_for = {algorithm, recipe->second};
    if (std::ranges::count(series_, asked_for) > 0) return asked_for;
  }
  std::optional<Series> best;
  std::ptrdiff_t most = 0;
  for (const Series& each : series_) {
    if (each.algorithm != algorithm) continue;
    const auto cells =
        std::ranges::count_if(cells_, [&](const auto& row) { return row.second.contains(each); });
    if (cells > most) best = each;
    most = std::max(most, cells);
  }
  return best;
}

}  // namespace b4mrl
