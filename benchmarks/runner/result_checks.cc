#include "benchmarks/runner/result_checks.h"

#include <fmt/format.h>
#include <poll.h>

#include <cerrno>
#include <deque>
#include <filesystem>
#include <list>
#include <map>
#include <system_error>
#include <utility>

#include "benchmarks/jobs/evaluation_job.h"
#include "benchmarks/jobs/job_queue.h"
#include "benchmarks/records/agent_check.h"
#include "benchmarks/records/copied_seeds.h"
#include "benchmarks/records/json_file.h"
#include "benchmarks/records/result_file.h"
#include "client/interrupt.h"
#include "data/d4rl/agent_file.h"
#include "data/files/file_hash.h"
#include "data/files/folder_listing.h"
#include "proto/base/child_program.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

Result<std::vector<std::string>> ResultsOf(const std::string& path) {
  std::error_code error;
  if (!fs::exists(path, error)) return IoError("open", path, ENOENT);
  if (!fs::is_directory(path, error)) return std::vector{path};
  return FilesIn(FolderOfResults(path), ".json");
}

// Paths of agents by their hashes.
Result<std::map<std::string, std::string>> AgentsBeside(const std::string& path) {
  std::error_code error;
  const std::string folder =
      fs::is_directory(path, error) ? path : fs::absolute(path, error).parent_path().string();
  std::map<std::string, std::string> agents;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code unknown;  // of a link to nothing, and of a file that is removed meanwhile
    if (entry->path().extension() != ".h5" || !entry->is_regular_file(unknown)) continue;
    auto hash = Sha256OfFile(entry->path());
    // A run that goes on there removes its old checkpoints.
    if (!hash.ok() && !fs::exists(entry->path(), unknown)) continue;
    if (!hash.ok()) return hash.status();
    agents.emplace(*std::move(hash), entry->path());
  }
  if (error) return IoError("list", folder, error.value());
  return agents;
}

// A folder that is removed at the end.
class ScratchFolder {
 public:
  explicit ScratchFolder(std::string path) : path_(std::move(path)) {}
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  std::string File(size_t number) const { return fmt::format("{}/{}.json", path_, number); }

 private:
  std::string path_;
};

struct Active {
  size_t number;  // of the result
  Job job;
};

// Compares an agent, whose file another process has read without harm, with its result.
Status Compare(const std::string& agent_path, const nlohmann::ordered_json& result,
               const CheckSources& sources, CheckedResult* checked) {
  B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(agent_path));
  B4MRL_ASSIGN_OR_RETURN(const auto faults, AgentFaults(agent, result, sources));
  checked->faults.insert(checked->faults.end(), faults.begin(), faults.end());
  return Status();
}

// Compares an evaluation with the result of the same agent.
Status Compare(const std::string& evaluation, const nlohmann::ordered_json& result,
               CheckedResult* checked) {
  B4MRL_ASSIGN_OR_RETURN(const auto json, ReadJsonObject(evaluation));
  const auto returns = NumbersOf(json, "returns");
  if (!returns || returns != NumbersOf(result, "returns")) {
    checked->faults.push_back(fmt::format("its agent has the returns {}, not {}",
                                          EntryOf(json, "returns").dump(),
                                          EntryOf(result, "returns").dump()));
  }
  return Status();
}

}  // namespace

Result<std::vector<CheckedResult>> CheckResults(const ResultCheckOptions& options,
                                                const CheckSources& sources) {
  B4MRL_ASSIGN_OR_RETURN(const auto files, ResultsOf(options.path));
  if (files.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no results", options.path));
  }
  B4MRL_ASSIGN_OR_RETURN(const auto agents, AgentsBeside(options.path));
  B4MRL_ASSIGN_OR_RETURN(std::string folder, MakeTemporaryFolder("b4mrl-check"));
  const ScratchFolder scratch(std::move(folder));
  std::vector<CheckedResult> checked;
  std::vector<nlohmann::ordered_json> results;
  std::deque<size_t> waiting;
  for (const std::string& file : files) {
    auto faults = CheckResult(file, sources);
    auto json = ReadJsonObject(file);
    checked.push_back(
        {file, faults.ok() ? *std::move(faults) : std::vector{faults.status().message()}});
    results.push_back(json.ok() ? *std::move(json) : nlohmann::ordered_json());
    if (agents.contains(TextOf(results.back(), "agent_sha256"))) {
      waiting.push_back(checked.size() - 1);
      checked.back().agent = AgentCheck::kNotReached;
    }
  }
  const auto copied = CopiedSeeds(results, files);
  for (size_t i = 0; i < checked.size(); ++i) {
    checked[i].faults.insert(checked[i].faults.end(), copied[i].begin(), copied[i].end());
  }
  std::list<Active> active;
  const auto begin = [&](size_t number) {
    const nlohmann::ordered_json& result = results[number];
    const size_t episodes = NumbersOf(result, "returns").value_or(std::vector<double>()).size();
    if (episodes == 0 || episodes > limits::kMaxLanesPerSession) return true;
    const auto perturbations = ScoredUnder(result, sources);
    if (!perturbations.ok()) return true;  // which its faults say
    const EvaluationOrder order = {.agent = agents.at(TextOf(result, "agent_sha256")),
                                   .environment = TextOf(result, "environment"),
                                   .simulator = *perturbations,
                                   .episodes = static_cast<uint32_t>(episodes)};
    Result<Job> job = StartEvaluation(order, scratch.File(number), UniqueFd());
    if (job.ok()) active.push_back({number, *std::move(job)});
    if (!job.ok()) checked[number].faults.push_back(job.status().message());
    return true;
  };
  const auto finish = [&](Active& ended, int exit_code) {
    CheckedResult& which = checked[ended.number];
    which.agent = AgentCheck::kScored;
    const std::string file = scratch.File(ended.number);
    if (exit_code != 0) {
      which.faults.push_back(fmt::format("its agent could not be scored: code {}", exit_code));
      return;
    }
    Status compared = KeepEvaluation(file);
    const nlohmann::ordered_json& result = results[ended.number];
    if (compared.ok()) compared = Compare(file, result, &which);
    if (compared.ok()) {
      compared = Compare(agents.at(TextOf(result, "agent_sha256")), result, sources, &which);
    }
    if (!compared.ok()) which.faults.push_back(compared.message());
  };
  while (!Interrupted() && !(active.empty() && waiting.empty())) {
    BeginWaiting(
        waiting, [&] { return active.size() < options.jobs; }, begin);
    CollectEnded(active, finish);
    if (!active.empty()) poll(nullptr, 0, kJobPollMs);
  }
  return checked;
}

}  // namespace b4mrl
