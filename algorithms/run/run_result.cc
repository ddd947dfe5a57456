#include "algorithms/run/run_result.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/file.h>

#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <utility>

#include "data/files/atomic_file.h"
#include "proto/base/clock.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxResultBytes = 1 << 20;
constexpr int kMaxDepth = 2;  // an object of numbers, texts, and lists and objects of them
// How long to wait for the lock: ReadRunStatus holds it for microseconds, a training for longer.
constexpr int64_t kLockPatienceMs = 200;
constexpr int kLockPauseMs = 10;

constexpr std::array<std::pair<RunState, std::string_view>, 6> kStates = {{
    {RunState::kRunning, "running"},
    {RunState::kFinished, "finished"},
    {RunState::kInterrupted, "interrupted"},
    {RunState::kDiverged, "diverged"},
    {RunState::kFailed, "failed"},
    {RunState::kKilled, "killed"},
}};

std::string ResultPath(const std::string& folder) { return folder + "/result.json"; }
std::string LockPath(const std::string& folder) { return folder + "/lock"; }

// The JSON text; bytes of the command line that are not UTF-8 are replaced, as they would throw.
std::string Text(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void SetState(Json& json, RunState state, const std::string& reason) {
  json["state"] = RunStateName(state);
  json["reason"] = reason;
  json["interrupted"] = state == RunState::kInterrupted;
}

Json SummaryObject(const TrainOptions& options, const TrainSummary& summary) {
  Json json;
  SetState(json, summary.state, summary.reason);
  json["updates"] = summary.updates;
  json["environment_steps"] = summary.environment_steps;
  for (const RunUseEntry& entry : kRunUseEntries) {
    json["ledger"][std::string(entry.name)] = summary.use.*entry.value;
  }
  json["algorithm"] = options.algorithm;
  json["environment"] = options.environment;
  json["simulator"] = options.simulator;
  json["world"] = options.world;
  json["dataset"] = options.dataset;
  if (!summary.dataset.full_name.empty()) {
    json["dataset_full_name"] = summary.dataset.full_name;
    json["dataset_columns_sha256"] = summary.dataset.columns_sha256;
  }
  json["corruption"] = options.corruption;
  json["corruption_seed"] = options.corruption_seed;
  const std::string& rule_in_force = summary.dataset.transition_rule;
  json["transitions"] = rule_in_force.empty() ? options.transitions : rule_in_force;
  json["seed"] = options.seed;
  json["precision"] = PrecisionName(options.precision);
  if (!summary.last) return json;
  if (!summary.agent_path.empty()) json["agent"] = summary.agent_path;
  json["evaluation_updates"] = summary.last_updates;
  json["returns"] = summary.last->returns;
  json["mean_return"] = summary.last->mean_return;
  json["std_return"] = summary.last->std_return;
  if (summary.last->given_up > 0) json["given_up_episodes"] = summary.last->given_up;
  if (summary.last->score) json["score"] = *summary.last->score;
  json["mean_return_of_last_ten"] = summary.mean_return_of_last_ten;
  if (summary.mean_score_of_last_ten) {
    json["mean_score_of_last_ten"] = *summary.mean_score_of_last_ten;
  }
  return json;
}

Result<Json> ReadResult(const std::string& folder) {
  const std::string path = ResultPath(folder);
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(path, kMaxResultBytes));
  Json json = ParseShallow<Json>(text, kMaxDepth);
  if (json.is_object()) return json;
  return Status(StatusCode::kDataLoss, fmt::format("{} is not a run's result", path));
}

Result<RunStatus> StatusOf(const Json& json, const std::string& folder) {
  const Json state = json.value("state", Json());
  const Json reason = json.value("reason", Json());
  const Json updates = json.value("updates", Json());
  for (const auto& [value, name] : kStates) {
    if (state != name || !reason.is_string() || !updates.is_number_unsigned()) continue;
    return RunStatus{value, reason.get<std::string>(), updates.get<uint64_t>()};
  }
  return Status(StatusCode::kDataLoss,
                fmt::format("{} names no state, reason and updates", ResultPath(folder)));
}

bool SomebodyTrainsIn(const std::string& folder) {
  const UniqueFd fd(open(LockPath(folder).c_str(), O_RDONLY | O_CLOEXEC));
  return fd.valid() && flock(fd.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

}  // namespace

std::string_view RunStateName(RunState state) { return kStates[static_cast<size_t>(state)].second; }

std::string SummaryJson(const TrainOptions& options, const TrainSummary& summary) {
  return Text(SummaryObject(options, summary));
}

Status WriteResult(const TrainOptions& options, const TrainSummary& summary) {
  return WriteSmallFile(ResultPath(options.folder), SummaryJson(options, summary) + "\n");
}

void TakeEarlierScores(const std::string& folder, TrainSummary* summary) {
  const Result<Json> json = ReadResult(folder);
  if (!json.ok()) return;
  const auto number = [&](const char* name) -> std::optional<double> {
    const Json value = json->value(name, Json());
    return value.is_number() ? std::optional(value.get<double>()) : std::nullopt;
  };
  const auto count = [&](const char* name) -> uint64_t {
    const Json value = json->value(name, Json());
    return value.is_number_unsigned() ? value.get<uint64_t>() : 0;
  };
  const uint64_t updates = count("evaluation_updates");
  const Json returns = json->value("returns", Json());
  if (!returns.is_array() || returns.empty()) return;
  if (summary->last && updates <= summary->last_updates) return;
  EvaluationResult last;
  for (const Json& value : returns) {
    if (value.is_number()) last.returns.push_back(value.get<double>());
  }
  last.given_up = static_cast<uint32_t>(count("given_up_episodes"));
  last.mean_return = number("mean_return").value_or(0);
  last.std_return = number("std_return").value_or(0);
  last.score = number("score");
  summary->last = std::move(last);
  summary->last_updates = updates;
  summary->mean_return_of_last_ten = number("mean_return_of_last_ten").value_or(0);
  summary->mean_score_of_last_ten = number("mean_score_of_last_ten");
}

Status WriteResultState(const TrainOptions& options, RunState state, const std::string& reason) {
  const Result<Json> present = ReadResult(options.folder);
  Json json = present.ok() ? *present : SummaryObject(options, TrainSummary());
  SetState(json, state, reason);
  return WriteSmallFile(ResultPath(options.folder), Text(json) + "\n");
}

Result<UniqueFd> LockRunFolder(const std::string& folder) {
  const std::string path = LockPath(folder);
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
  if (!fd.valid()) return IoError("create", path, errno);
  const Deadline deadline = Deadline::AfterMs(kLockPatienceMs);
  while (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return IoError("lock", path, errno);
    if (deadline.expired()) {
      return Status(StatusCode::kBusy, fmt::format("another process trains in {}", folder));
    }
    poll(nullptr, 0, kLockPauseMs);
  }
  return fd;
}

Result<RunStatus> ReadRunStatus(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(Json json, ReadResult(folder));
  B4MRL_ASSIGN_OR_RETURN(RunStatus status, StatusOf(json, folder));
  if (status.state != RunState::kRunning || SomebodyTrainsIn(folder)) return status;
  // The run may have ended between reading the file and testing the lock: read again.
  B4MRL_ASSIGN_OR_RETURN(json, ReadResult(folder));
  B4MRL_ASSIGN_OR_RETURN(status, StatusOf(json, folder));
  if (status.state == RunState::kRunning) status.state = RunState::kKilled;
  return status;
}

}  // namespace b4mrl
