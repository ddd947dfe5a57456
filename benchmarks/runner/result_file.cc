#include "benchmarks/runner/result_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string_view>
#include <system_error>

#include "data/files/atomic_file.h"
#include "data/files/csv_lines.h"
#include "data/files/file_hash.h"
#include "proto/base/version.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxFileBytes = 64 << 20;
constexpr double kSettledPoints = 1.5;  // the largest drift of a settled run between two fifths

struct Evaluation {
  uint64_t updates = 0;
  uint64_t steps = 0;
  double seconds = 0;
  double mean_return = 0;
  double std_return = 0;
  std::optional<double> score;
};

// The rows of progress.csv that hold an evaluation.
Result<std::vector<Evaluation>> ReadEvaluations(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxFileBytes));
  std::vector<Evaluation> evaluations;
  std::map<std::string, size_t, std::less<>> columns;
  for (size_t at = 0; at < text.size();) {
    const size_t end = text.find('\n', at);
    if (end == std::string::npos) break;  // a line that is being written
    const auto cells = CellsOf(std::string_view(text).substr(at, end - at));
    at = end + 1;
    if (columns.empty()) {
      for (size_t i = 0; i < cells.size(); ++i) columns.emplace(cells[i], i);
      continue;
    }
    const auto number = [&](std::string_view name) -> std::optional<double> {
      const auto found = columns.find(name);
      if (found == columns.end() || found->second >= cells.size()) return std::nullopt;
      return NumberOf(cells[found->second]);
    };
    const auto mean = number("eval/mean_reward");
    const auto updates = number("train/n_updates");
    if (!mean || !updates) continue;
    evaluations.push_back({static_cast<uint64_t>(*updates),
                           static_cast<uint64_t>(number("time/total_timesteps").value_or(0)),
                           number("time/time_elapsed").value_or(0), *mean,
                           number("eval/std_reward").value_or(0), number("eval/score")});
  }
  return evaluations;
}

// The mean score, or return where there is no score, of the evaluations in (from, to] of the run.
std::optional<double> MeanBetween(const std::vector<Evaluation>& curve, double from, double to) {
  double sum = 0;
  int count = 0;
  const auto last = static_cast<double>(curve.back().updates);
  for (const Evaluation& each : curve) {
    const auto updates = static_cast<double>(each.updates);
    if (updates <= from * last || updates > to * last) continue;
    sum += each.score.value_or(each.mean_return);
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

Json OrNull(const std::optional<double>& number) { return number ? Json(*number) : Json(); }

Result<Json> ReadJson(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxFileBytes));
  Json json = Json::parse(text, nullptr, false);
  if (json.is_object()) return json;
  return Status(StatusCode::kDataLoss, fmt::format("{} holds no JSON object", path));
}

// The further evaluations that the folder holds, by name.
Result<Json> ScoringsJson(const PlannedRun& run, const std::string& run_folder) {
  Json json = Json::object();
  for (const Scoring& scoring : run.scorings) {
    const std::string path = ScoringPath(run_folder, scoring);
    std::error_code error;
    if (!std::filesystem::exists(path, error)) continue;
    B4MRL_ASSIGN_OR_RETURN(const Json printed, ReadJson(path));
    json[scoring.name] = {{"simulator", scoring.simulator},
                          {"observe", scoring.observe},
                          {"score", printed.value("score", Json())},
                          {"return", printed.value("mean_return", Json())},
                          {"returns", printed.value("returns", Json::array())}};
  }
  return json;
}

Json CurveJson(const std::vector<Evaluation>& curve) {
  Json json = Json::array();
  for (const Evaluation& each : curve) {
    json.push_back(
        {each.updates, each.steps, each.mean_return, each.std_return, OrNull(each.score)});
  }
  return json;
}

// One line for each entry and for each point of the curve, so that a change shows where it is.
std::string TextOf(const Json& json) {
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

}  // namespace

std::string ScoringPath(const std::string& run_folder, const Scoring& scoring) {
  return fmt::format("{}/score-{}.json", run_folder, scoring.name);
}

std::string ResultPath(const std::string& results_folder, const PlannedRun& run) {
  return fmt::format("{}/{}-{}.json", results_folder, run.name, run.id);
}

Status WriteResultOf(const PlannedRun& run, const std::string& run_folder,
                     const std::optional<UsedDataset>& dataset, const std::string& budget,
                     const std::string& results_folder) {
  B4MRL_ASSIGN_OR_RETURN(const auto curve, ReadEvaluations(run_folder + "/progress.csv"));
  if (curve.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const Json record, ReadJson(run_folder + "/run.json"));
  B4MRL_ASSIGN_OR_RETURN(const Json result, ReadJson(run_folder + "/result.json"));
  B4MRL_ASSIGN_OR_RETURN(const Json scorings, ScoringsJson(run, run_folder));
  const Evaluation& last = curve.back();
  const bool finished = result.value("state", Json()) == "finished" && last.updates >= run.updates;
  const auto last_fifth = MeanBetween(curve, 0.8, 1);
  const auto fifth_before = MeanBetween(curve, 0.6, 0.8);
  Json json = {{"id", run.id},
               {"cell", run.cell_id},
               {"benchmarks", run.benchmarks},
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
               {"precision", run.precision},
               {"hyperparameters", record.value("hyperparameters", Json::object())},
               {"budget", budget},
               {"planned_updates", run.updates},
               {"updates", last.updates},
               {"finished", finished},
               {"score", OrNull(last.score)},
               {"return", last.mean_return},
               {"returns", result.value("returns", Json::array())},
               {"scorings", scorings},
               {"last_fifth", OrNull(last_fifth)},
               {"fifth_before", OrNull(fifth_before)},
               {"settled", Json()},
               {"source", "own"},
               {"selection", "last"},
               {"environment_steps", last.steps},
               {"seconds", last.seconds},
               {"version", ProjectVersion()},
               {"sessions", record.value("sessions", Json::array())},
               {"curve_columns", {"updates", "steps", "return", "std", "score"}},
               {"curve", CurveJson(curve)}};
  if (last_fifth && fifth_before) {
    json["settled"] = std::abs(*last_fifth - *fifth_before) <= kSettledPoints;
  }
  if (dataset) {
    json["dataset"] = {{"name", dataset->name},
                       {"rows", dataset->rows},
                       {"sha256", dataset->sha256},
                       {"columns_sha256", dataset->columns_sha256}};
  }
  if (const auto agent = Sha256OfFile(run_folder + "/agent.h5"); agent.ok()) {
    json["agent_sha256"] = *agent;
  }
  return WriteSmallFile(ResultPath(results_folder, run), TextOf(json));
}

Result<std::optional<RunResult>> ReadResult(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::optional<RunResult>();
  B4MRL_ASSIGN_OR_RETURN(const Json json, ReadJson(path));
  const auto number = [&](const char* key) -> std::optional<double> {
    const auto found = json.find(key);
    if (found == json.end() || !found->is_number()) return std::nullopt;
    return found->get<double>();
  };
  const auto finished = json.find("finished");
  RunResult result;
  result.finished = finished != json.end() && finished->is_boolean() && finished->get<bool>();
  result.updates = static_cast<uint64_t>(std::max(number("updates").value_or(0), 0.0));
  result.score = number("score");
  result.mean_return = number("return").value_or(0);
  result.seconds = number("seconds").value_or(0);
  const Json scorings = json.value("scorings", Json::object());
  for (const auto& [name, scoring] : scorings.items()) result.scorings.insert(name);
  return std::optional(result);
}

}  // namespace b4mrl
