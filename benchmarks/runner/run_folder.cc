#include "benchmarks/runner/run_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>

#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"
#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

using Json = nlohmann::ordered_json;

constexpr std::string_view kMark = "failed.json";
constexpr size_t kShortId = 8;  // digits of the id in the name of a run's folder

// Removes the folder's entries whose names `chooses` accepts.
template <typename Chooses>
void RemoveFrom(const std::string& folder, Chooses chooses) {
  std::error_code error, ignored;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (chooses(entry->path().filename().string())) fs::remove_all(entry->path(), ignored);
  }
}

std::string FailurePath(const std::string& folder) { return folder + "/error.json"; }

std::string MarkPath(const std::string& folder) { return folder + "/" + std::string(kMark); }

}  // namespace

std::string RunFolder(const std::string& folder, const PlannedRun& run) {
  return fmt::format("{}/runs/{}-{}", folder, run.name, run.id.substr(0, kShortId));
}

std::string DatasetStem(const std::string& folder, std::string dataset) {
  std::ranges::replace(dataset, '/', '-');
  return fmt::format("{}/datasets/{}", folder, dataset);
}

void RemoveTraining(const std::string& folder) {
  const auto state = ReadRunStatus(folder);
  if (state.ok() && state->state != RunState::kFinished) return;
  RemoveFrom(folder, [](std::string_view name) {
    return name == "replay.bin" || name == "ensemble.h5" || name.starts_with("checkpoint-") ||
           name.starts_with("unreadable-checkpoint-");
  });
}

void RemoveProgress(const std::string& folder) {
  std::error_code ignored;
  const auto state = ReadRunStatus(folder);
  if (state.ok() && state->state == RunState::kFinished) {
    fs::rename(folder + "/agent.h5", fmt::format("{}/agent-{}.h5", folder, state->updates),
               ignored);
  }
  for (const char* name : {"/result.json", "/progress.csv"}) fs::remove(folder + name, ignored);
}

void RemoveScorings(const PlannedRun& run, const std::string& folder) {
  std::error_code ignored;
  for (const Scoring& scoring : run.scorings) fs::remove(ScoringPath(folder, scoring), ignored);
}

Status MarkDiverged(const std::string& folder, const RunStatus& state) {
  const Json mark = {{"reason", state.reason}, {"updates", state.updates}};
  return WriteSmallFile(MarkPath(folder),
                        mark.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
}

bool IsMarkedDiverged(const std::string& folder) {
  std::error_code error;
  return fs::exists(MarkPath(folder), error);
}

void KeepFailure(const std::string& folder, const std::string& reason) {
  const Json error = {{"reason", reason}};
  const std::string text = error.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  [[maybe_unused]] const Status written = WriteSmallFile(FailurePath(folder), text);
}

void RemoveFailure(const std::string& folder) {
  std::error_code ignored;
  fs::remove(FailurePath(folder), ignored);
}

std::string FailureOf(const std::string& folder) {
  const auto error = ReadJsonObject(FailurePath(folder));
  return error.ok() ? TextOf(*error, "reason") : "";
}

Status RemoveDiverged(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(const UniqueFd lock, LockRunFolder(folder));
  RemoveFrom(folder, [](std::string_view name) {
    return name != "claim" && name != "lock" && name != kMark;
  });
  // The mark goes last, so that half a run is not resumed.
  std::error_code ignored;
  fs::remove(MarkPath(folder), ignored);
  return Status();
}

}  // namespace b4mrl
