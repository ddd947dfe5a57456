#include "benchmarks/evidence/scored_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <string_view>
#include <utility>

#include "algorithms/datasets/import_name.h"
#include "algorithms/list.h"
#include "benchmarks/plan/plan.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"

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

// Gives runs that are not to be compared with the others a series of their own.
void SetApart(const PublishedDatasets& published, ScoredRun* run) {
  Series& series = run->series;
  const bool is_projects = run->source == "own" && FindAlgorithm(series.algorithm).ok();
  if (run->source == "self-scored" && !series.algorithm.empty()) {
    series.algorithm += " (self-scored)";
  } else if (!is_projects && IsNameOfAlgorithm(series.algorithm, Algorithms())) {
    series.algorithm += " (user)";
  }
  std::string data;
  if (run->HasD4rlsData()) {
    data = "D4RL's data";
  } else if (PublishedOtherwise(published, run->dataset_file, run->columns_sha256) != nullptr) {
    data = "other rows";
  }
  if (data.empty()) return;
  series.has_other_data = true;
  series.recipe += (series.recipe.empty() ? "" : ", ") + data;
}

bool HasScale(const CurvePoint& point) {
  return std::abs(point.mean_return) <= kLargestScore &&
         std::abs(point.score.value_or(0)) <= kLargestScore;
}

}  // namespace

bool ScoredRun::HasD4rlsData() const { return IsOfD4rl(dataset_file); }

std::optional<uint64_t> ScoredRun::LastEvaluation(uint64_t end) const {
  const auto after =
      std::ranges::upper_bound(curve, std::min(end, updates), {}, &CurvePoint::updates);
  return after == curve.begin() ? std::nullopt : std::optional(std::prev(after)->updates);
}

std::optional<ScoredRun> ScoredRun::At(uint64_t end) const {
  const auto count = LastEvaluation(end);
  if (!count) return std::nullopt;
  ScoredRun run = *this;
  std::erase_if(run.curve, [&](const CurvePoint& point) { return point.updates > *count; });
  const CurvePoint& last = run.curve.back();
  run.ended |= end <= updates;
  run.diverged &= end > updates;
  run.is_part |= last.updates < updates;
  // The agent's scores seen otherwise belong to the end of the run.
  if (last.updates != updates) run.further.clear();
  run.updates = last.updates;
  run.score = last.score.value_or(last.mean_return);
  run.is_return = !last.score;
  run.fifths = FifthsOf(run.curve);
  return run;
}

Result<ScoredRun> ReadScoredRun(const Json& json, const ReadingLimit& limit,
                                const PublishedDatasets& published) {
  ScoredRun run;
  run.id = TextOf(json, "id");
  run.cell_key = CellKey(json);
  run.series = {TextOf(json, "algorithm"), TextOf(json, "recipe")};
  run.seed = CountOf(json, "seed").value_or(0);
  run.simulator = TextOf(json, "simulator");
  run.dataset = DatasetName(json);
  run.benchmarks = TextsOf(json, "benchmarks");
  ReadOrigin(json, &run);
  SetApart(published, &run);
  auto curve = ReadCurve(EntryOf(json, "curve"));
  if (run.id.empty() || TextOf(json, "cell").empty() || run.series.algorithm.empty() || !curve) {
    return Status(StatusCode::kDataLoss, "it is no result of a run");
  }
  if (!std::ranges::all_of(*curve, HasScale)) {
    return Status(StatusCode::kDataLoss, fmt::format("it has scores beyond {:g}", kLargestScore));
  }
  const auto has_score = [](const CurvePoint& point) { return point.score.has_value(); };
  if (std::ranges::any_of(*curve, has_score) && !std::ranges::all_of(*curve, has_score)) {
    return Status(StatusCode::kDataLoss, "some of its evaluations have a score, and others none");
  }
  run.curve = *std::move(curve);
  run.updates = CountOf(json, "updates").value_or(0);
  run.diverged = HasDiverged(json);
  run.ended = IsTrue(json, "finished") || run.diverged;
  run.learns_until = LearnsUntil(run.source, EntryOf(json, "hyperparameters"));
  run.is_return = !run.curve.empty() && !run.curve.back().score;
  ReadScorings(EntryOf(json, "scorings"), &run);
  const std::optional<uint64_t> end = limit ? limit(run) : std::nullopt;
  std::optional<ScoredRun> counting = run.At(end.value_or(UINT64_MAX));
  if (counting) return *std::move(counting);
  return Status(StatusCode::kDataLoss,
                fmt::format("it has no evaluation within {} updates", end.value_or(run.updates)));
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
