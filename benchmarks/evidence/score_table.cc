#include "benchmarks/evidence/score_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <memory>
#include <set>
#include <tuple>
#include <utility>

#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"
#include "data/files/folder_listing.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// No score or return is as large: figures would have no scale, and sums would be infinite.
constexpr double kLargestScore = 1e9;

struct Name {
  std::string_view algorithm, shown;
};
constexpr Name kNames[] = {{"td3", "TD3"},   {"sac", "SAC"},       {"bc", "BC"},
                           {"mopo", "MOPO"}, {"td3-bc", "TD3-BC"}, {"iql", "IQL"},
                           {"h2o", "H2O"},   {"hymopo", "HyMOPO"}};

void ReadScorings(const Json& scorings, ScoredRun* run) {
  if (!scorings.is_object()) return;
  for (const auto& [name, entry] : scorings.items()) {
    const auto score = NumberOf(entry, run->is_return ? "return" : "score");
    if (score && std::abs(*score) <= kLargestScore) run->further[name] = *score;
  }
}

void ReadOrigin(const Json& json, ScoredRun* run) {
  const Json& ledger = EntryOf(json, "ledger");
  run->simulator_steps = CountOf(ledger, "simulator_steps");
  run->query_rows = CountOf(ledger, "query_rows");
  run->dataset_rows = CountOf(ledger, "dataset_rows");
  run->core_hours = NumberOf(json, "seconds").value_or(0) / 3600;
  run->budget = TextOf(json, "budget");
  run->precision = TextOf(json, "precision");
  run->source = TextOf(json, "source");
  run->version = TextOf(json, "version");
  run->commit = TextOf(json, "commit");
  run->processor = TextOf(json, "processor");
  const Json& dataset = EntryOf(json, "dataset");
  run->dataset_file = TextOf(dataset, "name");
  run->rows = CountOf(dataset, "rows").value_or(0);
  run->columns_sha256 = TextOf(dataset, "columns_sha256");
  std::set<std::string> kernels;
  for (const Json& session : EntryOf(json, "sessions")) {
    kernels.insert(TextOf(session, "blas_kernel"));
  }
  run->kernel = fmt::format("{}", fmt::join(kernels, "+"));
}

bool HasScale(const CurvePoint& point) {
  return std::abs(point.mean_return) <= kLargestScore &&
         std::abs(point.score.value_or(0)) <= kLargestScore;
}

// The run of a result. The error says why the JSON is none that counts.
Result<ScoredRun> RunOf(const Json& json, const ReadingLimit& limit) {
  ScoredRun run;
  run.id = TextOf(json, "id");
  run.cell_id = TextOf(json, "cell");
  run.series = {TextOf(json, "algorithm"), TextOf(json, "recipe")};
  run.seed = CountOf(json, "seed").value_or(0);
  run.simulator = TextOf(json, "simulator");
  run.dataset = TextOf(EntryOf(json, "dataset"), "name");
  // "HalfCheetah/medium-v0" is the dataset "HalfCheetah/medium" of its suite.
  const std::string version = "-" + TextOf(json, "suite");
  if (run.dataset.ends_with(version)) run.dataset.resize(run.dataset.size() - version.size());
  for (const Json& name : EntryOf(json, "benchmarks")) {
    if (name.is_string()) run.benchmarks.push_back(name.get<std::string>());
  }
  ReadOrigin(json, &run);
  auto curve = ReadCurve(EntryOf(json, "curve"));
  if (run.id.empty() || run.series.algorithm.empty() || !curve) {
    return Status(StatusCode::kDataLoss, "it is no result of a run");
  }
  if (!std::ranges::all_of(*curve, HasScale)) {
    return Status(StatusCode::kDataLoss, fmt::format("it has scores beyond {:g}", kLargestScore));
  }
  run.curve = *std::move(curve);
  run.updates = CountOf(json, "updates").value_or(0);
  run.ended = IsTrue(json, "finished");
  run.is_return = !run.curve.empty() && !run.curve.back().score;
  ReadScorings(EntryOf(json, "scorings"), &run);
  const uint64_t end = limit ? limit(run).value_or(run.updates) : run.updates;
  std::optional<ScoredRun> counting = run.At(end);
  if (counting) return *std::move(counting);
  return Status(StatusCode::kDataLoss, fmt::format("it has no evaluation within {} updates", end));
}

std::optional<double> MovementOf(const ScoredRun& run) { return run.fifths.Movement(); }

}  // namespace

std::optional<ScoredRun> ScoredRun::At(uint64_t end) const {
  ScoredRun run = *this;
  std::erase_if(run.curve, [end](const CurvePoint& point) { return point.updates > end; });
  if (run.curve.empty()) return std::nullopt;
  const CurvePoint& last = run.curve.back();
  run.ended |= end < updates;
  // The agent's scores seen otherwise belong to the end of the run.
  if (last.updates != updates) run.further.clear();
  run.updates = last.updates;
  run.score = last.score.value_or(last.mean_return);
  run.is_return = !last.score;
  run.fifths = FifthsOf(run.curve);
  return run;
}

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

Course Cell::CourseOfScore() const {
  if (!std::ranges::all_of(runs, &ScoredRun::ended)) return Course::kRising;
  const auto movement = MeanOf(MovementOf);
  if (!movement) return Course::kUntold;
  const auto tolerance = MeanOf([](const ScoredRun& run) { return run.fifths.tolerance; });
  if (std::abs(*movement) <= *tolerance) return Course::kSettled;
  return *movement > 0 ? Course::kRising : Course::kFalling;
}

uint64_t Cell::LeastUpdates() const {
  return (*std::ranges::min_element(runs, {}, &ScoredRun::updates))->updates;
}

uint64_t Cell::MostUpdates() const {
  return (*std::ranges::max_element(runs, {}, &ScoredRun::updates))->updates;
}

Result<ScoreTable> ScoreTable::Read(const std::string& folder,
                                    const std::vector<Benchmark>& benchmarks,
                                    const ReadingLimit& limit,
                                    const std::map<std::string, std::string>& main_recipes) {
  B4MRL_ASSIGN_OR_RETURN(const auto files, FilesIn(FolderOfResults(folder), ".json"));
  if (files.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no results", folder));
  }
  ScoreTable table;
  table.main_recipes_ = main_recipes;
  table.runs_ = std::make_shared<std::vector<ScoredRun>>();
  table.earlier_ = std::make_shared<std::deque<ScoredRun>>();
  for (const std::string& path : files) {
    const std::string file = std::filesystem::path(path).filename();
    const auto json = ReadJsonObject(path);
    if (!json.ok()) {
      table.notes_.push_back(fmt::format("{} was left out: no JSON object can be read", file));
      continue;
    }
    auto run = RunOf(*json, limit);
    if (!run.ok()) {
      table.notes_.push_back(fmt::format("{} was left out: {}", file, run.status().message()));
      continue;
    }
    run->file = file;
    table.runs_->push_back(*std::move(run));
  }
  table.SortRuns();
  table.AddCells(benchmarks);
  table.LeaveOutUnfinishedSeeds();
  table.MarkRunsInCells();
  table.ReadSeedsAtEqualUpdates();
  table.NoteMixedRuns();
  return table;
}

void ScoreTable::SortRuns() {
  std::map<std::pair<std::string, std::string>, size_t> sizes;
  for (const ScoredRun& run : *runs_) ++sizes[{run.cell_id, run.columns_sha256}];
  std::ranges::stable_sort(*runs_, {}, [&](const ScoredRun& run) {
    const size_t others = runs_->size() - sizes.at({run.cell_id, run.columns_sha256});
    return std::tuple(others, run.cell_id, run.columns_sha256, run.seed, !run.ended,
                      UINT64_MAX - run.updates, run.precision);
  });
}

void ScoreTable::AddCells(const std::vector<Benchmark>& benchmarks) {
  std::set<std::string> known;
  for (const Benchmark& benchmark : benchmarks) known.insert(benchmark.name);
  std::set<Series> used;
  std::set<std::string> left_out;
  for (const ScoredRun& run : *runs_) {
    const std::set<std::string> names(run.benchmarks.begin(), run.benchmarks.end());
    for (const std::string& name : names) {
      if (!known.contains(name)) continue;
      Cell& cell = cells_[name][run.series];
      used.insert(run.series);
      const ScoredRun* other = cell.runs.empty() ? nullptr : cell.runs.back();
      if (other == nullptr) {
        cell.runs.push_back(&run);
      } else if (other->cell_id != run.cell_id || other->columns_sha256 != run.columns_sha256) {
        left_out.insert(fmt::format(
            "{} was left out: {} fills its cell with other hyperparameters or rows of the dataset",
            run.file, other->file));
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
      if (std::ranges::none_of(cell.runs, &ScoredRun::ended)) continue;
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

void ScoreTable::MarkRunsInCells() {
  std::set<const ScoredRun*> in_cells;
  for (const auto& [benchmark, row] : cells_) {
    for (const auto& [series, cell] : row) in_cells.insert(cell.runs.begin(), cell.runs.end());
  }
  std::set<std::string> known;
  for (const Benchmark* benchmark : benchmarks_) known.insert(benchmark->name);
  for (ScoredRun& run : *runs_) {
    run.fills_a_cell = in_cells.contains(&run);
    const auto is_known = [&](const std::string& name) { return known.contains(name); };
    if (std::ranges::any_of(run.benchmarks, is_known)) continue;
    notes_.push_back(fmt::format(
        "{} was left out: it names no benchmark of these suites (--suites for your own)",
        run.file));
  }
}

void ScoreTable::ReadSeedsAtEqualUpdates() {
  std::map<std::pair<const ScoredRun*, uint64_t>, const ScoredRun*> known;
  for (auto& [benchmark, row] : cells_) {
    for (auto& [series, cell] : row) {
      const uint64_t least = cell.LeastUpdates();
      for (const ScoredRun*& run : cell.runs) {
        if (run->updates == least) continue;
        const auto [entry, is_new] = known.emplace(std::pair(run, least), run);
        if (is_new) {
          std::optional<ScoredRun> earlier = run->At(least);
          if (!earlier) continue;  // its first evaluation came later
          notes_.push_back(fmt::format(
              "{} has gone on to {} updates and is read at {}, which all seeds of its cell have",
              run->file, run->updates, earlier->updates));
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
      if (!noted.insert(cell.runs.front()->cell_id).second) continue;
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

std::string DisplayName(const std::string& algorithm) {
  const auto* found = std::ranges::find(kNames, std::string_view(algorithm), &Name::algorithm);
  return found == std::end(kNames) ? algorithm : std::string(found->shown);
}

std::string DisplayName(const Series& series) {
  const std::string name = DisplayName(series.algorithm);
  return series.recipe.empty() ? name : fmt::format("{} ({})", name, series.recipe);
}

size_t OrderOf(const std::string& algorithm) {
  return static_cast<size_t>(
      std::ranges::find(kNames, std::string_view(algorithm), &Name::algorithm) - kNames);
}

}  // namespace b4mrl
