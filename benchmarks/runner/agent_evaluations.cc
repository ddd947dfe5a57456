#include "benchmarks/runner/agent_evaluations.h"

#include <fmt/format.h>
#include <poll.h>

#include <deque>
#include <filesystem>
#include <list>
#include <set>
#include <system_error>
#include <utility>

#include "algorithms/base/progress.h"
#include "benchmarks/jobs/evaluation_job.h"
#include "benchmarks/jobs/job_queue.h"
#include "client/interrupt.h"
#include "data/d4rl/agent_file.h"
#include "data/files/file_hash.h"
#include "data/files/folder_listing.h"
#include "data/files/make_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr size_t kHashDigits = 16;
// How often an agent is evaluated whose file another one replaces meanwhile.
constexpr int kMostTries = 3;

// Paths of the agents of a folder.
Result<std::vector<std::string>> AgentsIn(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<std::string> paths, FilesBelow(folder, ".h5"));
  const fs::path here = (fs::path(folder) / "agent.h5").parent_path();
  std::erase_if(paths, [&](const fs::path& path) {
    return path.filename() != "agent.h5" && path.parent_path() != here;
  });
  return paths;
}

class Evaluations {
 public:
  explicit Evaluations(const AgentEvaluationOptions& options) : options_(options) {}

  Result<AgentEvaluationSummary> Work();

 private:
  struct Agent {
    std::string path, result;  // result: where its evaluation is kept
    int tries = 1;
  };
  struct Active {
    Agent agent;
    Job job;
  };

  bool Begin(const Agent& agent);  // false: another program evaluates it
  Result<bool> TryToBegin(const Agent& agent);
  void Finish(const Agent& agent, int exit_code);
  Result<std::string> ResultOf(const std::string& path) const;
  void Fail(const Agent& agent, std::string_view reason);
  void Say(const std::string& line) const {
    if (!options_.quiet) Tell(line + "\n");
  }

  const AgentEvaluationOptions& options_;
  std::deque<Agent> waiting_;
  std::list<Active> active_;
  AgentEvaluationSummary summary_;
};

Result<AgentEvaluationSummary> Evaluations::Work() {
  B4MRL_ASSIGN_OR_RETURN(const auto paths, AgentsIn(options_.folder));
  if (paths.empty()) {
    return Status(StatusCode::kIoError, fmt::format("{} holds no agents", options_.folder));
  }
  B4MRL_RETURN_IF_ERROR(MakeFolder(options_.folder + "/evaluations"));
  std::set<std::string> results;
  for (const std::string& path : paths) {
    const auto result = ResultOf(path);
    if (Interrupted()) break;
    if (!result.ok()) Fail({path, ""}, result.status().message());
    if (result.ok() && results.insert(*result).second) waiting_.push_back({path, *result});
  }
  summary_.agents = waiting_.size() + summary_.failed.size();
  while (!Interrupted() && !(active_.empty() && waiting_.empty())) {
    BeginWaiting(
        waiting_, [this] { return active_.size() < options_.jobs; },
        [this](const Agent& agent) { return Begin(agent); });
    CollectEnded(active_,
                 [this](const Active& ended, int exit_code) { Finish(ended.agent, exit_code); });
    if (!(active_.empty() && waiting_.empty())) poll(nullptr, 0, kJobPollMs);
  }
  StopAll(active_, [](const Active&, int) {});
  summary_.interrupted = Interrupted();
  return summary_;
}

Result<std::string> Evaluations::ResultOf(const std::string& path) const {
  B4MRL_ASSIGN_OR_RETURN(const std::string hash,
                         Sha256OfFile(path, kMaxAgentFileBytes, UnlessInterrupted));
  return fmt::format("{}/evaluations/{}-e{}-s{}.json", options_.folder, hash.substr(0, kHashDigits),
                     options_.episodes, options_.seed);
}

bool Evaluations::Begin(const Agent& agent) {
  const Result<bool> begun = TryToBegin(agent);
  if (begun.ok()) return *begun;
  Fail(agent, begun.status().message());
  return true;
}

Result<bool> Evaluations::TryToBegin(const Agent& agent) {
  B4MRL_ASSIGN_OR_RETURN(UniqueFd claim, Claim(agent.result + ".claim"));
  if (!claim.valid()) return false;
  std::error_code error;
  if (fs::exists(agent.result, error)) {
    ++summary_.done;
    return true;
  }
  const auto read = ReadAgent(agent.path);
  if (!read.ok() || read->provenance.environment.empty()) {
    Fail(agent, read.ok() ? "the file does not name its environment" : read.status().message());
    return true;
  }
  std::vector<std::string> daemon_words;
  if (!options_.endpoint.empty()) daemon_words = {"--endpoint", options_.endpoint};
  const EvaluationOrder order = {.agent = agent.path,
                                 .environment = read->provenance.environment,
                                 .simulator = read->provenance.world,
                                 .episodes = options_.episodes,
                                 .daemon_words = daemon_words,
                                 .seed = options_.seed};
  B4MRL_ASSIGN_OR_RETURN(Job job, StartEvaluation(order, agent.result, std::move(claim)));
  Say(fmt::format("start {}", agent.path));
  active_.push_back({agent, std::move(job)});
  return true;
}

void Evaluations::Finish(const Agent& agent, int exit_code) {
  // A training that goes on there replaces its agent, and which one was read nobody knows.
  const auto result = ResultOf(agent.path);
  if (!result.ok()) return Fail(agent, result.status().message());
  if (*result != agent.result) {
    if (agent.tries == kMostTries) {
      return Fail(agent, fmt::format("was replaced while it was evaluated, {} times", kMostTries));
    }
    return waiting_.push_back({agent.path, *result, agent.tries + 1});
  }
  if (exit_code != 0) {
    return Fail(
        agent, fmt::format("ended with code {}, see {}", exit_code, LogOfEvaluation(agent.result)));
  }
  const Status kept = KeepEvaluation(agent.result);
  if (!kept.ok()) return Fail(agent, kept.message());
  ++summary_.done;
}

void Evaluations::Fail(const Agent& agent, std::string_view reason) {
  summary_.failed.push_back(fmt::format("{}: {}", agent.path, reason));
  Say(fmt::format("fail  {}", summary_.failed.back()));
}

}  // namespace

Result<AgentEvaluationSummary> EvaluateAgents(const AgentEvaluationOptions& options) {
  return Evaluations(options).Work();
}

}  // namespace b4mrl
