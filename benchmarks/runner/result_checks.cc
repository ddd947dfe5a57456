#include "benchmarks/runner/result_checks.h"

#include <fmt/format.h>
#include <poll.h>

#include <cerrno>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <list>
#include <map>
#include <set>
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
#include "proto/base/clock.h"
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

// Paths of agents by their hashes, as far as these are wanted: other files may be there as well,
// such as datasets of many gigabytes.
Result<std::map<std::string, std::string>> AgentsBeside(const std::string& path,
                                                        std::set<std::string> wanted) {
  std::error_code error;
  const std::string folder =
      fs::is_directory(path, error) ? path : fs::absolute(path, error).parent_path().string();
  std::map<std::string, std::string> agents;
  if (wanted.empty()) return agents;
  B4MRL_ASSIGN_OR_RETURN(const auto paths, FilesBelow(folder, ".h5"));
  for (const std::string& file : paths) {
    if (wanted.empty()) break;
    auto hash = Sha256OfFile(file, kMaxAgentFileBytes, UnlessInterrupted);
    if (hash.status().code() == StatusCode::kLimitExceeded) continue;  // is no agent
    // A run that goes on there removes its old checkpoints.
    if (!hash.ok() && !fs::exists(file, error)) continue;
    if (!hash.ok()) return hash.status();
    if (wanted.erase(*hash) > 0) agents.emplace(*std::move(hash), file);
  }
  return agents;
}

// Checks the results of a folder: first their files, then the agents that lie beside them. Of each
// result only its marks stay in memory, as others decide how much a file holds.
class ResultChecks {
 public:
  ResultChecks(const ResultCheckOptions& options, const CheckSources& sources,
               std::string scratch_folder)
      : options_(options), sources_(sources), scratch_(std::move(scratch_folder)) {}

  Result<std::vector<CheckedResult>> Work(const std::vector<std::string>& files);

 private:
  struct Active {
    size_t number;  // of the result
    Job job;
    Deadline deadline;
  };

  Status ReadFiles(const std::vector<std::string>& files);
  Status FindAgents();
  void ScoreAgents();
  void Begin(size_t number);
  Status TryToBegin(size_t number);
  void Finish(const Active& ended, int exit_code);
  Status TryToFinish(size_t number);
  std::string ScratchFile(size_t number) const {
    return fmt::format("{}/{}.json", scratch_.path(), number);
  }
  const std::string& AgentOf(size_t number) const {
    return agents_.at(TextOf(marks_[number], "agent_sha256"));
  }
  void Fault(size_t number, std::string text) {
    checked_[number].faults.push_back(std::move(text));
  }

  const ResultCheckOptions& options_;
  const CheckSources& sources_;
  const FolderRemover scratch_;
  std::vector<CheckedResult> checked_;
  std::vector<nlohmann::ordered_json> marks_;
  std::map<std::string, std::string> agents_;
  std::deque<size_t> waiting_;
  std::list<Active> active_;
};

Result<std::vector<CheckedResult>> ResultChecks::Work(const std::vector<std::string>& files) {
  B4MRL_RETURN_IF_ERROR(ReadFiles(files));
  B4MRL_RETURN_IF_ERROR(FindAgents());
  ScoreAgents();
  return std::move(checked_);
}

Status ResultChecks::ReadFiles(const std::vector<std::string>& files) {
  for (const std::string& file : files) {
    B4MRL_RETURN_IF_ERROR(UnlessInterrupted());
    const auto json = ReadJsonObject(file);
    checked_.push_back(
        {file, json.ok() ? FaultsOf(*json, file, sources_) : std::vector{json.status().message()}});
    marks_.push_back(json.ok() ? SeedMarks(*json) : nlohmann::ordered_json());
  }
  const auto copied = CopiedSeeds(marks_, files);
  for (size_t i = 0; i < checked_.size(); ++i) {
    for (const std::string& fault : copied[i]) Fault(i, fault);
  }
  return Status();
}

Status ResultChecks::FindAgents() {
  std::set<std::string> wanted;
  for (const auto& marks : marks_) wanted.insert(TextOf(marks, "agent_sha256"));
  wanted.erase("");
  B4MRL_ASSIGN_OR_RETURN(agents_, AgentsBeside(options_.path, std::move(wanted)));
  for (size_t i = 0; i < checked_.size(); ++i) {
    if (!agents_.contains(TextOf(marks_[i], "agent_sha256"))) continue;
    waiting_.push_back(i);
    checked_[i].agent = AgentCheck::kNotReached;
  }
  return Status();
}

void ResultChecks::ScoreAgents() {
  while (!Interrupted() && !(active_.empty() && waiting_.empty())) {
    BeginWaiting(
        waiting_, [this] { return active_.size() < options_.jobs; },
        [this](size_t number) {
          Begin(number);
          return true;
        });
    for (Active& each : active_) {
      if (each.deadline.expired() && !each.job.was_stopped()) each.job.Stop();
    }
    CollectEnded(active_, [this](const Active& ended, int code) { Finish(ended, code); });
    if (!active_.empty()) poll(nullptr, 0, kJobPollMs);
  }
  StopAll(active_, [](const Active&, int) {});
}

void ResultChecks::Begin(size_t number) {
  const Status begun = TryToBegin(number);
  if (!begun.ok()) Fault(number, begun.message());
}

Status ResultChecks::TryToBegin(size_t number) {
  B4MRL_ASSIGN_OR_RETURN(const auto result, ReadJsonObject(checked_[number].path));
  const size_t episodes = EpisodesToCompare(result);
  if (episodes == 0) return Status();
  if (episodes > limits::kMaxLanesPerSession) {
    return InvalidNumber(
        "number of returns beside an agent", static_cast<double>(episodes),
        fmt::format("at most {}, as many as are scored again", limits::kMaxLanesPerSession));
  }
  const auto perturbations = ScoredUnder(result, sources_);
  if (!perturbations.ok()) return Status();  // which its faults say
  const EvaluationOrder order = {.agent = AgentOf(number),
                                 .environment = TextOf(result, "environment"),
                                 .simulator = *perturbations,
                                 .episodes = static_cast<uint32_t>(episodes),
                                 .daemon_words = {"--endpoint", options_.endpoint}};
  B4MRL_ASSIGN_OR_RETURN(Job job, StartEvaluation(order, ScratchFile(number), UniqueFd()));
  active_.push_back({number, std::move(job), Deadline::AfterMs(options_.scoring_deadline_ms)});
  return Status();
}

void ResultChecks::Finish(const Active& ended, int exit_code) {
  const size_t number = ended.number;
  checked_[number].agent = AgentCheck::kScored;
  if (ended.job.was_stopped()) {
    return Fault(number, fmt::format("its agent could not be scored within {} s",
                                     options_.scoring_deadline_ms / 1000));
  }
  if (exit_code != 0) {
    Fault(number, fmt::format("its agent could not be scored: code {}", exit_code));
    return;
  }
  const Status finished = TryToFinish(number);
  if (!finished.ok()) Fault(number, finished.message());
}

Status ResultChecks::TryToFinish(size_t number) {
  const std::string file = ScratchFile(number);
  B4MRL_RETURN_IF_ERROR(KeepEvaluation(file));
  B4MRL_ASSIGN_OR_RETURN(const auto evaluation, ReadJsonObject(file));
  B4MRL_ASSIGN_OR_RETURN(const auto result, ReadJsonObject(checked_[number].path));
  ComparedReturns returns = CompareReturns(evaluation, result);
  if (!returns.agree) Fault(number, returns.words);
  checked_[number].agreement = std::move(returns.words);
  // Another process has read the agent's file without harm.
  B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(AgentOf(number)));
  B4MRL_ASSIGN_OR_RETURN(const auto faults, AgentFaults(agent, result, sources_));
  for (const std::string& fault : faults) Fault(number, fault);
  return Status();
}

}  // namespace

Result<std::vector<CheckedResult>> CheckResults(const ResultCheckOptions& options,
                                                const CheckSources& sources) {
  B4MRL_ASSIGN_OR_RETURN(const auto files, ResultsOf(options.path));
  if (files.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no results", options.path));
  }
  B4MRL_ASSIGN_OR_RETURN(std::string folder, MakeTemporaryFolder("b4mrl-check"));
  return ResultChecks(options, sources, std::move(folder)).Work(files);
}

}  // namespace b4mrl
