#include "benchmarks/evidence/scores.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <set>

#include "algorithms/list.h"
#include "benchmarks/evidence/growth.h"
#include "benchmarks/statistics/significance.h"
#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr size_t kPaperSeeds = 3;
constexpr size_t kSeedsForAnError = 3;
constexpr size_t kCellsForOwnDeviation = 10;
// The paper has no behaviour cloning; TD3-BC is the nearest that it has.
constexpr char kInPlaceOfBc[] = "td3-bc";

double RootMeanSquare(const std::vector<double>& values) {
  double squares = 0;
  for (const double value : values) squares += value * value;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

// From a deviation divided by the number of seeds to one divided by one less.
double Unbiased(double std, size_t seeds) {
  const auto count = static_cast<double>(seeds);
  return std * std::sqrt(count / (count - 1));
}

void SetErrorOfMean(CellScore* score) {
  score->standard_error =
      Unbiased(score->std, score->seeds) / std::sqrt(static_cast<double>(score->seeds));
  score->degrees = static_cast<double>(score->seeds - 1);
}

std::string EnvironmentOf(const std::string& benchmark) {
  return benchmark.substr(0, benchmark.find('/'));
}

}  // namespace

std::optional<Interval> CellScore::Interval95() const {
  if (std::isinf(standard_error)) return std::nullopt;
  const double quantile = std::isinf(degrees)
                              ? NormalQuantile(0.975)
                              : StudentQuantile(0.975, static_cast<size_t>(degrees));
  return Interval{mean - quantile * standard_error, mean + quantile * standard_error};
}

const CellScore* ScoreAt(const CellScore& score, uint64_t updates) {
  if (score.updates <= updates) return &score;
  const auto found = std::ranges::find(score.earlier, updates, &CellScore::updates);
  return found == score.earlier.end() ? nullptr : &*found;
}

std::optional<std::pair<CellScore, CellScore>> AtEqualUpdates(const CellScore& one,
                                                              const CellScore& other) {
  if (one.recipe != other.recipe) return std::nullopt;
  const uint64_t updates = std::min(one.updates, other.updates);
  const CellScore *first = ScoreAt(one, updates), *second = ScoreAt(other, updates);
  if (first == nullptr || second == nullptr) return std::nullopt;
  return std::pair(*first, *second);
}

const CellScore* Find(const CellScores& scores, const std::string& benchmark,
                      const std::string& algorithm) {
  const auto found = scores.find({benchmark, algorithm});
  return found == scores.end() ? nullptr : &found->second;
}

const CellScore* FindComparable(const CellScores& ours, const std::string& benchmark,
                                const std::string& algorithm) {
  const CellScore* own = Find(ours, benchmark, algorithm);
  return own == nullptr || own->has_other_rows ? nullptr : own;
}

std::string SharedRun(const Benchmark& benchmark, const std::string& algorithm) {
  const auto known = FindAlgorithm(algorithm);
  if (!known.ok()) return fmt::format("{} {}", algorithm, benchmark.name);
  const bool has_simulator = (*known)->needs.simulator, has_dataset = (*known)->needs.dataset;
  std::string hyperparameters;
  for (const auto& [name, value] : benchmark.hyperparameters) {
    hyperparameters += fmt::format(" {}={}", name, value);
  }
  return fmt::format("{} {} | {} | {} | {} |{}", benchmark.environment, algorithm, benchmark.world,
                     has_simulator ? benchmark.simulator : "",
                     has_dataset ? benchmark.dataset + " " + benchmark.corruption : "",
                     hyperparameters);
}

CellScores PaperScores(const std::vector<Benchmark>& benchmarks) {
  CellScores scores;
  for (const Benchmark& benchmark : benchmarks) {
    for (const auto& [algorithm, paper] : benchmark.paper) {
      CellScore score;
      score.mean = paper.mean;
      score.std = paper.std;
      score.seeds = kPaperSeeds;
      score.runs = SharedRun(benchmark, algorithm);
      SetErrorOfMean(&score);
      scores[{benchmark.name, algorithm}] = std::move(score);
    }
  }
  return scores;
}

std::optional<double> PooledPaperDeviation(const CellScores& paper, const std::string& environment,
                                           const std::string& algorithm) {
  std::vector<double> deviations;
  std::set<std::string> counted;
  for (const auto& [name, score] : paper) {
    if (name.second == algorithm && EnvironmentOf(name.first) == environment &&
        counted.insert(score.runs).second) {
      deviations.push_back(score.std);
    }
  }
  if (deviations.empty()) return std::nullopt;
  return RootMeanSquare(deviations);
}

BorrowedDeviations::BorrowedDeviations(const ScoreTable& table, const CellScores& paper) {
  std::map<Key, std::vector<double>> own;
  std::set<std::string> counted;
  for (const Benchmark* benchmark : table.benchmarks()) {
    for (const Series& series : table.series()) {
      const Cell* cell = table.Find(benchmark->name, series);
      if (cell == nullptr) continue;
      std::vector<double>& deviations = own[{benchmark->environment, series}];
      if (cell->runs.size() < kSeedsForAnError) continue;
      if (!counted.insert(cell->runs.front()->id).second) continue;
      deviations.push_back(Unbiased(cell->Deviation(), cell->runs.size()));
    }
  }
  for (const auto& [key, deviations] : own) {
    if (deviations.size() >= kCellsForOwnDeviation) {
      deviations_[key] = RootMeanSquare(deviations);
      continue;
    }
    const auto& [environment, series] = key;
    const std::string algorithm = series.algorithm == "bc" ? kInPlaceOfBc : series.algorithm;
    const auto pooled = PooledPaperDeviation(paper, environment, algorithm);
    if (pooled) deviations_[key] = *pooled;
  }
}

std::optional<double> BorrowedDeviations::Of(const std::string& environment,
                                             const Series& series) const {
  const auto found = deviations_.find({environment, series});
  return found == deviations_.end() ? std::nullopt : std::optional(found->second);
}

// Whether the run is known to have used one source alone.
bool HasOneSource(const ScoredRun* run) {
  if (!run->simulator_steps || !run->query_rows || !run->dataset_rows) return false;
  return (*run->simulator_steps == 0 && *run->query_rows == 0) || *run->dataset_rows == 0;
}

CellScore ScoreOf(const Benchmark& benchmark, const Cell& cell,
                  const BorrowedDeviations& deviations) {
  CellScore score;
  score.recipe = cell.runs.front()->series.recipe;
  score.has_other_rows = cell.runs.front()->HasOtherRows();
  score.mean = cell.Mean();
  score.std = cell.Deviation();
  score.seeds = cell.runs.size();
  score.settled = cell.IsSettled();
  score.surely_settled = cell.IsSurelySettled();
  score.course = cell.CourseOfScore();
  score.last_fifth = cell.MeanOf([](const ScoredRun& run) { return run.fifths.last; });
  score.gain_per_doubling =
      cell.MeanOf([](const ScoredRun& run) { return GainPerDoubling(run.curve); });
  score.has_one_source = std::ranges::all_of(cell.runs, HasOneSource);
  for (const ScoredRun* run : cell.runs) score.runs += run->id;
  score.updates = cell.LeastUpdates();
  if (score.seeds >= kSeedsForAnError) {
    SetErrorOfMean(&score);
  } else if (const auto deviation =
                 deviations.Of(benchmark.environment, cell.runs.front()->series)) {
    score.standard_error = *deviation / std::sqrt(static_cast<double>(score.seeds));
    score.is_borrowed = true;
  }
  return score;
}

// The score of the cell's runs after so many updates; nothing if one had no evaluation by then.
std::optional<CellScore> EarlierScoreOf(const Benchmark& benchmark, const Cell& cell,
                                        uint64_t updates, const BorrowedDeviations& deviations) {
  std::deque<ScoredRun> runs;
  Cell earlier;
  for (const ScoredRun* run : cell.runs) {
    std::optional<ScoredRun> at = run->At(updates);
    if (!at) return std::nullopt;
    runs.push_back(*std::move(at));
    earlier.runs.push_back(&runs.back());
  }
  CellScore score = ScoreOf(benchmark, earlier, deviations);
  score.updates = updates;
  return score;
}

CellScores OwnScores(const ScoreTable& table, const BorrowedDeviations& deviations,
                     const std::string& recipe) {
  // The first of these that has a cell counts.
  std::vector<Series> series = table.series();
  std::ranges::stable_sort(series, {}, [&](const Series& each) {
    const bool is_asked_for = !recipe.empty() && each.recipe == recipe;
    return is_asked_for ? 0 : table.MainSeries(each.algorithm) == each ? 1 : 2;
  });
  std::map<CellName, const Cell*> cells;
  std::map<std::string, std::set<uint64_t>> updates;  // by algorithm
  for (const Series& each : series) {
    if (each.has_other_data && table.MainSeries(each.algorithm) != each) continue;
    for (const Benchmark* benchmark : table.benchmarks()) {
      const Cell* cell = table.Find(benchmark->name, each);
      if (cell == nullptr) continue;
      if (!cells.emplace(CellName(benchmark->name, each.algorithm), cell).second) continue;
      updates[each.algorithm].insert(cell->LeastUpdates());
    }
  }
  CellScores scores;
  for (const Benchmark* benchmark : table.benchmarks()) {
    for (const auto& [algorithm, of_any] : updates) {
      const auto found = cells.find({benchmark->name, algorithm});
      if (found == cells.end()) continue;
      CellScore score = ScoreOf(*benchmark, *found->second, deviations);
      for (const uint64_t fewer : of_any) {
        if (fewer >= score.updates) break;
        auto earlier = EarlierScoreOf(*benchmark, *found->second, fewer, deviations);
        if (earlier) score.earlier.push_back(*std::move(earlier));
      }
      scores[found->first] = std::move(score);
    }
  }
  return scores;
}

std::set<std::string> OtherRecipes(const ScoreTable& table) {
  std::set<std::string> recipes;
  for (const Series& series : table.series()) {
    const bool is_main = table.MainSeries(series.algorithm) == series;
    if (is_main || series.has_other_data || series.recipe.empty()) continue;
    recipes.insert(series.recipe);
  }
  return recipes;
}

}  // namespace b4mrl
