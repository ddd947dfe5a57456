#include "algorithms/run/run_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <tuple>

#include "algorithms/base/checkpoint.h"
#include "algorithms/nn/products/blas.h"
#include "algorithms/run/run_result.h"
#include "data/d4rl/agent_file.h"
#include "data/files/atomic_file.h"
#include "proto/base/cores.h"
#include "proto/base/limits.h"
#include "proto/base/names.h"
#include "proto/base/rng.h"
#include "proto/base/version.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxRecordBytes = 1 << 20;
constexpr std::ptrdiff_t kSessionsKept = 100;

std::string RecordPath(const std::string& folder) { return folder + "/run.json"; }

Status NotUnderstood(std::string_view name, const Json& value, const std::string& allowed) {
  // Nested values are not printed: printing recurses, and a file may nest values without limit.
  const std::string text = value.is_structured()
                               ? std::string(value.type_name())
                               : value.dump(-1, ' ', false, Json::error_handler_t::replace);
  return Status(StatusCode::kDataLoss, InvalidArgument(name, text, allowed).message());
}

// These overloads read `value`, and leave it unchanged if the record lacks the name. kDataLoss
// names the entry, its content and the allowed values.
Status Take(const Json& json, const char* name, std::string& value) {
  const auto found = json.find(name);
  if (found == json.end() || found->is_null()) return Status();
  if (!found->is_string()) return NotUnderstood(name, *found, "a text");
  value = found->get_ref<const std::string&>();
  return Status();
}

// Checks the range of a number: the training loop divides by some, and too large ones would be
// truncated to T.
template <typename T>
Status Take(const Json& json, const char* name, T& value, uint64_t low, uint64_t high) {
  const auto found = json.find(name);
  if (found == json.end() || found->is_null()) return Status();
  if (!found->is_number_unsigned() || found->get<uint64_t>() < low ||
      found->get<uint64_t>() > high) {
    return NotUnderstood(name, *found, fmt::format("a whole number in {}..{}", low, high));
  }
  value = static_cast<T>(found->get<uint64_t>());
  return Status();
}

Status TakeNumbers(const Json& json, TrainOptions& options) {
  constexpr uint64_t kAny = std::numeric_limits<uint64_t>::max();
  B4MRL_RETURN_IF_ERROR(Take(json, "history", options.history_length, 1, kMaxAgentHistory));
  B4MRL_RETURN_IF_ERROR(Take(json, "seed", options.seed, 0, kAny));
  B4MRL_RETURN_IF_ERROR(Take(json, "corruption_seed", options.corruption_seed, 0, kAny));
  B4MRL_RETURN_IF_ERROR(Take(json, "updates", options.updates, 0, kAny));
  B4MRL_RETURN_IF_ERROR(Take(json, "eval_every", options.eval_every, 1, kAny));
  B4MRL_RETURN_IF_ERROR(
      Take(json, "eval_episodes", options.eval_episodes, 1, limits::kMaxLanesPerSession));
  B4MRL_RETURN_IF_ERROR(Take(json, "log_every", options.log_every, 1, kAny));
  B4MRL_RETURN_IF_ERROR(Take(json, "checkpoint_every", options.checkpoint_every, 1, kAny));
  B4MRL_RETURN_IF_ERROR(Take(json, "threads", options.threads, 1, kMaxTrainingThreads));
  const auto score = json.find("stop_at_score");
  if (score != json.end() && score->is_number()) options.stop_at_score = score->get<double>();
  return Status();
}

Status TakeHyperparameters(const Json& json, RunRecord& record) {
  const auto table = json.find("hyperparameters");
  if (table == json.end() || !table->is_object()) {
    return Status(StatusCode::kDataLoss, "it has no table of hyperparameters");
  }
  for (const auto& [name, value] : table->items()) {
    if (!value.is_number() && !value.is_string()) {
      return NotUnderstood(name, value, "a number or a text");
    }
    record.hyperparameters.emplace_back(
        name, value.is_number() ? value.dump() : value.get<std::string>());
  }
  return Status();
}

Status TakeOptions(const Json& json, RunRecord& record) {
  TrainOptions& options = record.options;
  B4MRL_RETURN_IF_ERROR(Take(json, "algorithm", options.algorithm));
  B4MRL_RETURN_IF_ERROR(Take(json, "environment", options.environment));
  B4MRL_RETURN_IF_ERROR(Take(json, "simulator", options.simulator));
  B4MRL_RETURN_IF_ERROR(Take(json, "world", options.world));
  B4MRL_RETURN_IF_ERROR(Take(json, "dataset", options.dataset));
  B4MRL_RETURN_IF_ERROR(Take(json, "corruption", options.corruption));
  B4MRL_RETURN_IF_ERROR(Take(json, "transitions", options.transitions));
  B4MRL_RETURN_IF_ERROR(Take(json, "command", options.command));
  // Records of earlier versions have no precision: their runs are in fp32.
  std::string precision(PrecisionName(Precision::kFp32));
  B4MRL_RETURN_IF_ERROR(Take(json, "precision", precision));
  const std::optional<Precision> found = FindPrecision(precision);
  if (!found) return NotUnderstood("precision", precision, "fp32 or bf16");
  options.precision = *found;
  B4MRL_RETURN_IF_ERROR(TakeNumbers(json, options));
  return TakeHyperparameters(json, record);
}

RunSession SessionOf(const Json& json) {
  const auto text = [&](const char* name) {
    const auto found = json.find(name);
    return found != json.end() && found->is_string() ? found->get<std::string>() : "";
  };
  return {text("version"), text("blas_kernel"), text("processor"), text("commit"),
          text("architecture")};
}

Json ToJson(const RunSession& session) {
  return {{"version", session.version},
          {"commit", session.commit},
          {"architecture", session.architecture},
          {"blas_kernel", session.blas_kernel},
          {"processor", session.processor}};
}

// The record's sessions. A record of an older program version stores only its last session.
std::vector<RunSession> TakeSessions(const Json& json) {
  std::vector<RunSession> sessions;
  const auto found = json.find("sessions");
  if (found != json.end() && found->is_array()) {
    for (const Json& item : *found) {
      if (item.is_object()) sessions.push_back(SessionOf(item));
    }
  }
  if (sessions.empty() && json.contains("version")) sessions.push_back(SessionOf(json));
  return sessions;
}

// The newest sessions of `before`, and `present` if it differs from the last of them.
std::vector<RunSession> WithPresent(std::span<const RunSession> before, const RunSession& present) {
  std::vector<RunSession> all(before.begin(), before.end());
  if (all.empty() || all.back() != present) all.push_back(present);
  if (all.size() > kSessionsKept) all.erase(all.begin(), all.end() - kSessionsKept);
  return all;
}

// A TOML string; JSON's escapes are among TOML's.
std::string Quoted(const std::string& text) {
  return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

// "horizon = 5  # steps: steps of a rollout in the model; from junming-yang/mopo"
std::string ConfigurationLine(const Hyperparameter& entry) {
  const bool quoted = !entry.choices.empty() && !entry.IsSwitch();
  const std::string text = quoted ? Quoted(entry.Text()) : entry.Text();
  std::string line = fmt::format("{} = {}  # ", entry.name, text);
  if (!entry.unit.empty()) line += fmt::format("{}: ", entry.unit);
  line += entry.meaning;
  if (!entry.source.empty()) line += fmt::format("; from {}", entry.source);
  return line + "\n";
}

// Whether `c` needs no quoting in shells and is allowed in file names by all file systems.
bool IsPlain(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
         std::string_view(".,=+-").find(c) != std::string_view::npos;
}

}  // namespace

std::string RunName(const TrainOptions& options, const LearnerNeeds& needs) {
  std::string name = fmt::format("{}-{}", options.environment, options.algorithm);
  // A hybrid's dataset must not be taken for a simulator.
  const bool hybrid = needs.simulator && needs.dataset;
  if (!options.simulator.empty() || hybrid) {
    name += "-" + (options.simulator.empty() ? "true" : options.simulator);
  }
  const bool own_dataset = options.dataset.starts_with(options.environment + "/");
  if (!options.dataset.empty()) {
    name += "-" + options.dataset.substr(own_dataset ? options.environment.size() + 1 : 0);
  }
  if (!options.corruption.empty()) name += "+" + options.corruption;
  if (options.corruption_seed != 0) name += fmt::format("+c{}", options.corruption_seed);
  if (options.transitions != "stored") name += "+" + options.transitions;
  if (!options.world.empty()) name += "-in-" + options.world;
  if (options.history_length > 1) name += fmt::format("-h{}", options.history_length);
  if (options.precision != Precision::kFp32)
    name += fmt::format("-{}", PrecisionName(options.precision));
  name += fmt::format("-s{}", options.seed);

  const std::string all = name;
  std::ranges::replace_if(
      name, [](char c) { return !IsPlain(c); }, '_');
  constexpr size_t kHashBytes = 17;
  const bool whole = name == all && name.size() <= kMaxRunNameBytes;
  if (whole && (own_dataset || options.dataset.empty())) return name;
  name.resize(std::min(name.size(), kMaxRunNameBytes - kHashBytes));
  return fmt::format("{}-{:016x}", name, HashName(all));
}

std::string FolderOfRun(const TrainOptions& options, const LearnerNeeds& needs) {
  const std::string folder = "runs/" + RunName(options, needs);
  if (!options.resume || VersionOf(options.dataset).empty() || HasRunRecord(folder)) return folder;
  TrainOptions begun = options;
  begun.dataset = WithoutVersion(options.dataset);
  const std::string earlier = "runs/" + RunName(begun, needs);
  const Result<RunRecord> record = ReadRunRecord(earlier);
  return record.ok() && record->options.dataset == options.dataset ? earlier : folder;
}

Status WriteRunConfiguration(const TrainOptions& options) {
  std::string text = "# b4mrl train --config THIS_FILE --out FOLDER repeats the run.\n";
  const auto add = [&](std::string_view name, const auto& value) {
    text += fmt::format("{} = {}\n", name, value);
  };
  add("algorithm", Quoted(options.algorithm));
  add("environment", Quoted(options.environment));
  if (!options.simulator.empty()) add("simulator", Quoted(options.simulator));
  if (!options.world.empty()) add("world", Quoted(options.world));
  if (!options.dataset.empty()) add("dataset", Quoted(options.dataset));
  if (!options.corruption.empty()) add("corruption", Quoted(options.corruption));
  if (options.corruption_seed != 0) {
    add("corruption-seed", Quoted(fmt::format("{}", options.corruption_seed)));
  }
  if (!options.dataset.empty()) add("transitions", Quoted(options.transitions));
  add("history", options.history_length);
  add("seed", Quoted(fmt::format("{}", options.seed)));  // TOML's integers have a sign
  add("precision", Quoted(std::string(PrecisionName(options.precision))));
  add("updates", options.updates);
  add("eval-every", options.eval_every);
  add("eval-episodes", options.eval_episodes);
  add("log-every", options.log_every);
  add("checkpoint-every", options.checkpoint_every);
  add("threads", options.threads);
  if (options.stop_at_score) add("stop-at-score", *options.stop_at_score);
  text += fmt::format("\n# Hyperparameters of {}\n", options.algorithm);
  for (const Hyperparameter& entry : options.hyperparameters.entries()) {
    text += ConfigurationLine(entry);
  }
  return WriteSmallFile(options.folder + "/config.toml", text);
}

Status WriteRunRecord(const TrainOptions& options, std::span<const RunSession> before) {
  Json json;
  json["algorithm"] = options.algorithm;
  json["environment"] = options.environment;
  json["simulator"] = options.simulator;
  json["world"] = options.world;
  json["dataset"] = options.dataset;
  json["corruption"] = options.corruption;
  json["corruption_seed"] = options.corruption_seed;
  json["transitions"] = options.transitions;
  json["history"] = options.history_length;
  json["seed"] = options.seed;
  json["precision"] = PrecisionName(options.precision);
  json["updates"] = options.updates;
  json["eval_every"] = options.eval_every;
  json["eval_episodes"] = options.eval_episodes;
  json["log_every"] = options.log_every;
  json["checkpoint_every"] = options.checkpoint_every;
  json["threads"] = options.threads;
  json["stop_at_score"] = options.stop_at_score ? Json(*options.stop_at_score) : Json(nullptr);
  json["hyperparameters"] = Json::object();
  for (const Hyperparameter& entry : options.hyperparameters.entries()) {
    Json& value = json["hyperparameters"][std::string(entry.name)];
    if (entry.choices.empty()) {
      value = entry.value;
    } else {
      value = entry.Text();
    }
  }
  json["command"] = options.command;
  const RunSession present = PresentSession();
  json.update(ToJson(present));
  json["sessions"] = Json::array();
  for (const RunSession& session : WithPresent(before, present)) {
    json["sessions"].push_back(ToJson(session));
  }
  // `replace` keeps bytes of the command line that are not UTF-8 from throwing.
  return WriteSmallFile(RecordPath(options.folder),
                        json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

RunSession PresentSession() {
  return {std::string(ProjectVersion()), BlasKernelName(), ProcessorName(),
          std::string(BuildCommit()), std::string(LearnerArchitecture())};
}

std::string RunSession::Text() const {
  const auto known = [](const std::string& text) {
    return text.empty() ? "unknown" : text.c_str();
  };
  return fmt::format("version {} (commit {}) for {} on BLAS kernel {}", version, known(commit),
                     known(architecture), blas_kernel);
}

namespace {

// Refuses a folder without checkpoints in which a training from the first update would replace what
// somebody wants to keep.
Status CheckNothingIsLost(const TrainOptions& options) {
  const std::string& folder = options.folder;
  const auto refuse = [&](std::string_view what) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("{} {}; choose another --out, or move it away", folder, what));
  };
  const auto has = [&](const char* name) {
    std::error_code error;
    return std::filesystem::exists(fmt::format("{}/{}", folder, name), error);
  };
  const Result<RunStatus> state = ReadRunStatus(folder);
  if (state.ok() && state->state == RunState::kFinished) {
    return refuse("holds a finished run without a checkpoint from which it could go on");
  }
  const Result<RunRecord> record = ReadRunRecord(folder);
  if (has("ensemble.h5") && record.ok() && !IsRecordOf(*record, options)) {
    return refuse("holds the model of a run with other options, which has not come further yet");
  }
  if (state.ok() || record.ok()) return Status();  // a run that has not come to a checkpoint
  for (const char* name : {"agent.h5", "result.json", "run.json", "config.toml", "metrics.jsonl",
                           "progress.csv", "replay.bin", "ensemble.h5"}) {
    if (has(name)) return refuse(fmt::format("holds a file {} that is of no run there", name));
  }
  return Status();
}

}  // namespace

Status CheckEarlierRun(const TrainOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(const auto checkpoints, ListCheckpoints(options.folder));
  if (checkpoints.empty()) return CheckNothingIsLost(options);
  if (options.resume) {
    if (options.updates >= checkpoints.front()) return Status();
    return InvalidArgument(
        "--updates", fmt::format("{}", options.updates),
        fmt::format("at least {}, which the run to be resumed has done", checkpoints.front()));
  }
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("{} holds an earlier run; continue it with --resume, or choose another "
                            "--out",
                            options.folder));
}

bool IsRecordOf(const RunRecord& record, const TrainOptions& options) {
  const auto identity = [](const TrainOptions& run) {
    return std::tie(run.algorithm, run.environment, run.simulator, run.world, run.dataset,
                    run.corruption, run.corruption_seed, run.transitions, run.history_length,
                    run.seed, run.precision);
  };
  if (identity(record.options) != identity(options)) return false;
  Hyperparameters recorded = options.hyperparameters;
  for (const auto& [name, text] : record.hyperparameters) {
    if (!recorded.SetText(name, text).ok()) return false;
  }
  return std::ranges::equal(recorded.entries(), options.hyperparameters.entries(),
                            [](const Hyperparameter& a, const Hyperparameter& b) {
                              return a.is_without_effect || a.value == b.value;
                            });
}

bool HasRunRecord(const std::string& folder) {
  std::error_code error;
  return std::filesystem::exists(RecordPath(folder), error);
}

Result<RunRecord> ReadRunRecord(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(const std::string text,
                         ReadSmallFile(RecordPath(folder), kMaxRecordBytes));
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  RunRecord record;
  if (!json.is_object()) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} is not a run's record", RecordPath(folder)));
  }
  if (const Status status = TakeOptions(json, record); !status.ok()) {
    return status.WithContext(RecordPath(folder));
  }
  record.sessions = TakeSessions(json);
  return record;
}

}  // namespace b4mrl
