#include "benchmarks/runner/frozen_plan.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "benchmarks/jobs/job_queue.h"
#include "benchmarks/records/json_file.h"
#include "data/files/atomic_file.h"
#include "data/files/make_folder.h"
#include "proto/base/clock.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 10'000;  // with another process that writes the list

std::string PlanPath(const std::string& folder) { return folder + "/plan.json"; }

// Writes the list if there is none: numbers of jobs point into the one that is there.
Status WriteOnce(const std::string& path, const std::string& text) {
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  B4MRL_RETURN_IF_ERROR(file.Write(text));
  const Status written = file.Commit(Existing::kKeep);
  return written.code() == StatusCode::kFailedPrecondition ? Status() : written;
}

}  // namespace

Result<std::vector<std::string>> FreezePlan(const std::string& folder,
                                            const std::vector<PlannedRun>& plan) {
  const std::string path = PlanPath(folder);
  B4MRL_RETURN_IF_ERROR(MakeFolder(folder));
  nlohmann::ordered_json json = {{"runs", nlohmann::ordered_json::array()}};
  for (const PlannedRun& run : plan) json["runs"].push_back({{"id", run.id}, {"name", run.name}});
  const Deadline patience = Deadline::AfterMs(kPatienceMs);
  std::error_code error;
  while (!std::filesystem::exists(path, error)) {
    const Status written = WriteOnce(path, json.dump(1) + "\n");
    if (!written.ok() && (written.code() != StatusCode::kBusy || patience.expired())) {
      return written;
    }
    if (written.ok()) break;
    poll(nullptr, 0, kJobPollMs);
  }
  return ReadFrozenPlan(folder);
}

Result<std::vector<std::string>> ReadFrozenPlan(const std::string& folder) {
  const std::string path = PlanPath(folder);
  std::vector<std::string> ids;
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return ids;
  B4MRL_ASSIGN_OR_RETURN(const auto json, ReadJsonObject(path, kMaxOwnFileBytes));
  for (const auto& run : EntryOf(json, "runs")) {
    ids.push_back(TextOf(run, "id"));
    if (ids.back().empty()) {
      return Status(StatusCode::kDataLoss, fmt::format("{} is no list of runs with ids", path));
    }
  }
  return ids;
}

Result<std::vector<uint64_t>> IndicesOf(const std::vector<PlannedRun>& plan,
                                        const std::vector<std::string>& frozen) {
  std::vector<uint64_t> indices;
  for (const PlannedRun& run : plan) {
    const auto found = std::ranges::find(frozen, run.id);
    if (found == frozen.end()) {
      return Status(
          StatusCode::kFailedPrecondition,
          fmt::format("plan.json, in --out, lacks the run {}: the list belongs to another "
                      "command; once that one's jobs have ended, choose another folder for --out "
                      "(--results may stay)",
                      run.name));
    }
    indices.push_back(static_cast<uint64_t>(found - frozen.begin()));
  }
  return indices;
}

Result<PlannedRun> FindByIndex(const std::vector<std::string>& frozen, uint64_t index,
                               const std::vector<PlannedRun>& plan) {
  if (index >= frozen.size()) {
    return InvalidNumber(
        "--index", index,
        fmt::format("0..{}, the runs of plan.json", frozen.empty() ? 0 : frozen.size() - 1));
  }
  const auto found = std::ranges::find(plan, frozen[index], &PlannedRun::id);
  if (found != plan.end()) return *found;
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("run {} of plan.json, {}, is not among those that this command asks "
                            "for; the list belongs to another command",
                            index, frozen[index]));
}

}  // namespace b4mrl
