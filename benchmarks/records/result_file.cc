#include "benchmarks/records/result_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string_view>
#include <system_error>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/run/run_ledger.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/learned.h"
#include "data/files/atomic_file.h"
#include "data/files/csv_lines.h"
#include "data/files/file_hash.h"
#include "data/files/folder_listing.h"
#include "proto/base/version.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxProgressBytes = 64 << 20;

// What progress.csv says at its evaluations: the curve, and the ledger at the last one.
struct Evaluations {
  Curve curve;
  Json ledger;
};

Result<Evaluations> ReadEvaluations(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(std::string text, ReadSmallFile(path, kMaxProgressBytes));
  text.resize(text.rfind('\n') + 1);  // without a line that is being written
  Evaluations read;
  std::map<std::string, size_t, std::less<>> columns;
  for (const std::string_view line : LinesOf(text)) {
    const auto cells = CellsOf(line);
    if (columns.empty()) {
      for (size_t i = 0; i < cells.size(); ++i) columns.emplace(cells[i], i);
      continue;
    }
    const auto number = [&](std::string_view name) -> std::optional<double> {
      const auto found = columns.find(name);
      if (found == columns.end() || found->second >= cells.size()) return std::nullopt;
      return NumberOf(cells[found->second]);
    };
    // Counts are logged as whole numbers, which doubles hold exactly below 2^53.
    const auto count = [&](std::string_view name) -> std::optional<uint64_t> {
      const auto found = number(name);
      if (!found || !(*found >= 0 && *found <= 0x1p53)) return std::nullopt;
      return static_cast<uint64_t>(*found);
    };
    const auto mean = number("eval/mean_reward");
    const auto updates = count("train/n_updates");
    if (!mean || !std::isfinite(*mean) || !updates) continue;
    read.curve.push_back({*updates, count("time/total_timesteps").value_or(0),
                          number("time/time_elapsed").value_or(0), *mean,
                          number("eval/std_reward").value_or(0), number("eval/score")});
    read.ledger = Json::object();
    for (const RunUseEntry& entry : kRunUseEntries) {
      const auto used = count(fmt::format("ledger/{}", entry.name));
      read.ledger[std::string(entry.name)] = used ? Json(*used) : Json();
    }
  }
  return read;
}

Json OrNull(const std::optional<double>& number) { return number ? Json(*number) : Json(); }
Json OrNull(const std::string& text) { return text.empty() ? Json() : Json(text); }

// The further evaluations that the folder holds, by name.
Result<Json> ScoringsJson(const PlannedRun& run, const std::string& run_folder) {
  Json json = Json::object();
  for (const Scoring& scoring : run.scorings) {
    const std::string path = ScoringPath(run_folder, scoring);
    std::error_code error;
    if (scoring.name == kOwnScoring || !std::filesystem::exists(path, error)) continue;
    B4MRL_ASSIGN_OR_RETURN(const Json printed, ReadJsonObject(path));
    json[scoring.name] = {{"simulator", scoring.simulator},
                          {"observe", scoring.observe},
                          {"score", EntryOf(printed, "score")},
                          {"return", EntryOf(printed, "mean_return")},
                          {"returns", EntryOf(printed, "returns")}};
  }
  return json;
}

// One line for each entry and for each point of the curve, so that a change shows where it is.
std::string LinesOf(const Json& json) {
  std::string text = "{\n";
  for (const auto& [key, value] : json.items()) {
    std::string shown = value.dump(-1, ' ', false, Json::error_handler_t::replace);
    if (key == "curve") {
      shown = "[\n";
      for (const Json& point : value) {
        shown += fmt::format("  {}{}\n", point.dump(), &point == &value.back() ? "" : ",");
      }
      shown += " ]";
    }
    text += fmt::format(" \"{}\": {},\n", key, shown);
  }
  text.erase(text.size() - 2, 1);  // the last entry's comma
  return text + "}\n";
}

// Why a training diverged, of its result.json; "": it did not. Behind a semicolon that names the
// last good state by its path, which means nothing elsewhere.
std::string DivergenceOf(const Json& result) {
  if (TextOf(result, "state") != "diverged") return "";
  const std::string reason = TextOf(result, "reason");
  return reason.substr(0, std::min(reason.find(';'), kMostDivergedBytes));
}

// What `b4mrl train` has left in a folder.
Result<RunOutcome> OutcomeOfTraining(const std::string& folder) {
  RunOutcome outcome;
  B4MRL_ASSIGN_OR_RETURN(Evaluations evaluations, ReadEvaluations(folder + "/progress.csv"));
  outcome.curve = std::move(evaluations.curve);
  outcome.ledger = std::move(evaluations.ledger);
  if (outcome.curve.empty()) return outcome;
  B4MRL_ASSIGN_OR_RETURN(const Json record, ReadJsonObject(folder + "/run.json"));
  B4MRL_ASSIGN_OR_RETURN(const Json result, ReadJsonObject(folder + "/result.json"));
  outcome.ended = TextOf(result, "state") == "finished";
  outcome.diverged = DivergenceOf(result);
  // While a run goes on, its result.json is that of an earlier session.
  if (CountOf(result, "evaluation_updates") == outcome.curve.back().updates) {
    outcome.returns = EntryOf(result, "returns");
  }
  outcome.columns_sha256 = TextOf(result, "dataset_columns_sha256");
  outcome.hyperparameters = EntryOf(record, "hyperparameters");
  outcome.sessions = EntryOf(record, "sessions");
  outcome.processor = TextOf(record, "processor");
  return outcome;
}

// The entries that say what was trained on what.
Json RunJson(const PlannedRun& run, const std::optional<UsedDataset>& dataset) {
  Json json = {{"id", run.id},
               {"cell", run.cell_id},
               {"benchmarks", run.all_benchmarks},
               {"suite", run.suite},
               {"algorithm", run.algorithm},
               {"environment", run.environment},
               {"simulator", run.simulator},
               {"dataset", Json()},
               {"corruption", run.corruption},
               {"corruption_seed", 0},
               {"transitions", "stored"},
               {"history", 1},
               {"world", run.world},
               {"seed", run.seed},
               {"precision", OrNull(run.precision)},
               {"recipe", OrNull(run.recipe)}};
  if (dataset) {
    json["dataset"] = {{"name", dataset->name},
                       {"rows", dataset->rows},
                       {"sha256", dataset->sha256},
                       {"columns_sha256", dataset->columns_sha256}};
  }
  return json;
}

// Whether the run has finished. A learner of the user's own decides that itself.
bool HasFinished(const RunOutcome& outcome, const ResultOrigin& origin) {
  const bool did_all = outcome.source != "own" || outcome.curve.back().updates >= origin.updates;
  return outcome.ended && did_all;
}

// Whether a result stays as it is beside what its run has come to now.
bool HasComeFurther(const RunResult& before, const RunOutcome& outcome,
                    const ResultOrigin& origin) {
  const bool has_finished = HasFinished(outcome, origin);
  if (before.finished != has_finished) return before.finished;
  // A user's learner begins anew when it is asked for more, and says itself how far it came.
  return outcome.source == "own" && before.updates > outcome.curve.back().updates;
}

void AddScores(const RunOutcome& outcome, const ResultOrigin& origin, Json* json) {
  const CurvePoint& last = outcome.curve.back();
  const Fifths fifths = FifthsOf(outcome.curve);
  const std::optional<bool> settled =
      HasSettled(fifths, last.updates, LearnsUntil(outcome.source, outcome.hyperparameters));
  json->update({{"updates", last.updates},
                {"finished", HasFinished(outcome, origin)},
                {"score", OrNull(last.score)},
                {"return", last.mean_return},
                {"returns", outcome.returns},
                {"last_fifth", OrNull(fifths.last)},
                {"fifth_before", OrNull(fifths.before)},
                {"settled", settled ? Json(*settled) : Json()}});
}

// Adds those that are not there yet. Returns whether there was one.
bool AddBenchmarks(const std::vector<std::string>& more, Json* json) {
  std::vector<std::string> names = TextsOf(*json, "benchmarks");
  const size_t named = names.size();
  for (const std::string& name : more) {
    if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  }
  (*json)["benchmarks"] = names;
  return names.size() > named;
}

// Whether a result is of the training that the one before it tells of. A user's learner that is
// asked for more, or finds other rows, begins anew, and may come to the same numbers again.
bool IsOfSameTraining(const Json& before, const Json& json) {
  const auto rows = [](const Json& of) { return TextOf(EntryOf(of, "dataset"), "columns_sha256"); };
  return EntryOf(before, "curve") == EntryOf(json, "curve") && rows(before) == rows(json) &&
         CountOf(before, "planned_updates") >= CountOf(json, "planned_updates");
}

// What stays of the result that `json` is to replace. A plan with fewer suites takes no benchmark
// away, and a further scoring changes nothing of what was trained on which rows, for which budget
// and by which program.
void KeepOrigin(const std::string& path, Json* json) {
  const Result<Json> before = ReadJsonObject(path);
  if (!before.ok()) return;
  AddBenchmarks(TextsOf(*before, "benchmarks"), json);
  if (!IsTrue(*before, "finished") || !IsOfSameTraining(*before, *json)) return;
  for (const char* key : {"budget", "planned_updates", "version", "commit", "dataset"}) {
    if (before->contains(key)) (*json)[key] = EntryOf(*before, key);
  }
}

}  // namespace

std::string ScoringPath(const std::string& run_folder, const Scoring& scoring) {
  return fmt::format("{}/score-{}.json", run_folder, scoring.name);
}

std::string CellKey(const Json& result) {
  return fmt::format("{} {} {} {} {} {}", TextOf(result, "cell"),
                     TextOf(EntryOf(result, "dataset"), "columns_sha256"),
                     TextOf(result, "simulator"), TextOf(result, "corruption"),
                     TextOf(result, "world"), TextOf(result, "source"));
}

std::string DatasetName(const Json& result) {
  return std::string(ShortName(TextOf(EntryOf(result, "dataset"), "name")));
}

bool HasDiverged(const Json& result) {
  const size_t bytes = TextOf(result, "diverged").size();
  return bytes > 0 && bytes <= kMostDivergedBytes && !IsTrue(result, "finished");
}

std::optional<uint64_t> LearnsUntil(std::string_view source, const Json& hyperparameters) {
  const double updates = NumberOf(hyperparameters, "cosine-updates").value_or(0);
  if (source != "own" || updates < 1) return std::nullopt;
  return static_cast<uint64_t>(std::min(updates, 1e18));  // what files say may be beyond 64 bits
}

std::optional<bool> HasSettled(const Fifths& fifths, uint64_t updates,
                               std::optional<uint64_t> learns_until) {
  if (learns_until && updates >= *learns_until) return true;
  return fifths.IsSettled();
}

std::string FolderOfResults(const std::string& folder) {
  std::error_code error;
  const std::string inside = folder + "/results";
  if (!std::filesystem::is_directory(inside, error)) return folder;
  // A copy of a folder of results into another one lies inside it under that name.
  const auto own = FilesIn(folder, ".json");
  const bool holds_results =
      own.ok() && std::ranges::any_of(*own, [](const std::string& path) {
        const auto read = ReadJsonObject(path);
        return read.ok() && EntryOf(*read, "benchmarks").is_array() && read->contains("curve");
      });
  return holds_results ? folder : inside;
}

std::string ResultPath(const std::string& results_folder, const PlannedRun& run) {
  return fmt::format("{}/{}-{}.json", results_folder, run.name, run.id);
}

Result<uint64_t> EvaluatedUpdates(const std::string& run_folder) {
  B4MRL_ASSIGN_OR_RETURN(const Evaluations read, ReadEvaluations(run_folder + "/progress.csv"));
  return read.curve.empty() ? 0 : read.curve.back().updates;
}

Result<uint64_t> WriteResultOf(const PlannedRun& run, const std::string& run_folder,
                               const std::optional<UsedDataset>& dataset,
                               const ResultOrigin& origin, const std::string& results_folder) {
  const std::string path = ResultPath(results_folder, run);
  B4MRL_ASSIGN_OR_RETURN(const RunOutcome outcome, run.is_users() ? OutcomeOfLearner(run_folder)
                                                                  : OutcomeOfTraining(run_folder));
  const Curve& curve = outcome.curve;
  if (curve.empty()) return 0;
  if (dataset && !outcome.columns_sha256.empty() &&
      dataset->columns_sha256 != outcome.columns_sha256) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("{} has other rows now than those that {} learned from",
                              dataset->name, run.name));
  }
  const uint64_t updates = curve.back().updates;
  B4MRL_ASSIGN_OR_RETURN(const auto before, ReadResult(path));
  if (before && HasComeFurther(*before, outcome, origin)) return updates;
  B4MRL_ASSIGN_OR_RETURN(const Json scorings, ScoringsJson(run, run_folder));
  Json json = RunJson(run, dataset);
  json.update({{"hyperparameters", outcome.hyperparameters},
               {"budget", origin.budget},
               {"planned_updates", outcome.planned_updates.value_or(origin.updates)}});
  AddScores(outcome, origin, &json);
  if (!outcome.diverged.empty()) json["diverged"] = outcome.diverged;
  json.update({{"scorings", scorings},
               {"source", outcome.source},
               {"selection", "last"},
               {"environment_steps", curve.back().steps},
               {"ledger", outcome.ledger},
               {"seconds", curve.back().seconds},
               {"version", ProjectVersion()},
               {"commit", OrNull(origin.commit)},
               {"processor", outcome.processor},
               {"sessions", outcome.sessions}});
  if (!outcome.learner_sha256.empty()) json["learner_sha256"] = outcome.learner_sha256;
  const auto agent = Sha256OfFile(run_folder + "/agent.h5");
  json["agent_sha256"] = agent.ok() ? Json(*agent) : Json();
  json["curve_columns"] = {"updates", "steps", "return", "std", "score"};
  json["curve"] = JsonOf(curve);
  if (before) KeepOrigin(path, &json);
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(path, LinesOf(json)));
  return updates;
}

Status NameAllBenchmarks(const PlannedRun& run, const std::string& results_folder) {
  const std::string path = ResultPath(results_folder, run);
  B4MRL_ASSIGN_OR_RETURN(Json json, ReadJsonObject(path));
  return AddBenchmarks(run.all_benchmarks, &json) ? WriteSmallFile(path, LinesOf(json)) : Status();
}

bool RunResult::IsDone(const PlannedRun& run, uint64_t target) const {
  if (run.is_users() && IsOfOtherRows(run)) return false;
  return finished && (run.is_users() ? planned_updates : updates) >= target;
}

bool RunResult::IsOfOtherRows(const PlannedRun& run) const {
  return !columns_sha256.empty() && !run.rows_at_hand.empty() && columns_sha256 != run.rows_at_hand;
}

Result<std::optional<RunResult>> ReadResult(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::optional<RunResult>();
  B4MRL_ASSIGN_OR_RETURN(const Json json, ReadJsonObject(path));
  RunResult result;
  result.finished = IsTrue(json, "finished");
  result.updates = CountOf(json, "updates").value_or(0);
  result.planned_updates = CountOf(json, "planned_updates").value_or(0);
  result.settled = IsTrue(json, "settled");
  result.score = NumberOf(json, "score");
  result.mean_return = NumberOf(json, "return").value_or(0);
  result.seconds = NumberOf(json, "seconds").value_or(0);
  result.agent_sha256 = TextOf(json, "agent_sha256");
  result.learner_sha256 = TextOf(json, "learner_sha256");
  result.columns_sha256 = TextOf(EntryOf(json, "dataset"), "columns_sha256");
  for (const auto& [name, scoring] : EntryOf(json, "scorings").items()) {
    result.scorings.insert(name);
  }
  return std::optional(result);
}

}  // namespace b4mrl
