#include "benchmarks/runner/agent_evaluations.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <list>
#include <map>
#include <system_error>
#include <utility>

#include "benchmarks/runner/job.h"
#include "client/interrupt.h"
#include "data/d4rl/agent_file.h"
#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int kPollMs = 200;
constexpr size_t kHashDigits = 16;
constexpr size_t kMaxOutput = 64 << 20;  // bytes that an evaluation may print

// Paths of agents by the beginning of their hashes.
Result<std::map<std::string, std::string>> AgentsIn(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    const bool is_agent =
        path.filename() == "agent.h5" || (entry.depth() == 0 && path.extension() == ".h5");
    if (is_agent && entry->is_regular_file(error)) paths.push_back(path);
  }
  if (error) return IoError("list", folder, error.value());
  std::ranges::sort(paths);
  std::map<std::string, std::string> agents;
  for (const std::string& path : paths) {
    B4MRL_ASSIGN_OR_RETURN(const std::string hash, Sha256OfFile(path));
    agents.emplace(hash.substr(0, kHashDigits), path);
  }
  return agents;
}

class Evaluations {
 public:
  explicit Evaluations(const AgentEvaluationOptions& options) : options_(options) {}

  Result<AgentEvaluationSummary> Work();

 private:
  struct Agent {
    std::string path, result;  // result: where its evaluation is kept
  };
  struct Active {
    Agent agent;
    Job job;
  };

  Status StartWhatCan();
  Result<bool> Begin(const Agent& agent);  // false: another program evaluates it
  Status Collect();
  Status Keep(const Agent& agent) const;
  void Fail(const Agent& agent, std::string_view reason);
  void Say(const std::string& line) const {
    if (!options_.quiet) fmt::print(stderr, "{}\n", line);
  }

  const AgentEvaluationOptions& options_;
  std::deque<Agent> waiting_;
  std::list<Active> active_;
  AgentEvaluationSummary summary_;
};

Result<AgentEvaluationSummary> Evaluations::Work() {
  B4MRL_ASSIGN_OR_RETURN(const auto agents, AgentsIn(options_.folder));
  const std::string folder = options_.folder + "/evaluations";
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return IoError("make", folder, error.value());
  for (const auto& [hash, path] : agents) {
    waiting_.push_back(
        {path, fmt::format("{}/{}-e{}-s{}.json", folder, hash, options_.episodes, options_.seed)});
  }
  summary_.agents = agents.size();
  while (!Interrupted() && !(active_.empty() && waiting_.empty())) {
    B4MRL_RETURN_IF_ERROR(StartWhatCan());
    B4MRL_RETURN_IF_ERROR(Collect());
    if (!(active_.empty() && waiting_.empty())) poll(nullptr, 0, kPollMs);
  }
  active_.clear();  // stops what still runs
  summary_.interrupted = Interrupted();
  return summary_;
}

Status Evaluations::StartWhatCan() {
  std::deque<Agent> later;
  while (!waiting_.empty() && active_.size() < options_.jobs) {
    Agent agent = std::move(waiting_.front());
    waiting_.pop_front();
    B4MRL_ASSIGN_OR_RETURN(const bool begun, Begin(agent));
    if (!begun) later.push_back(std::move(agent));
  }
  waiting_.insert(waiting_.begin(), later.begin(), later.end());
  return Status();
}

Result<bool> Evaluations::Begin(const Agent& agent) {
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
  fs::remove(agent.result + ".log", error);  // of an earlier attempt
  B4MRL_ASSIGN_OR_RETURN(Job job, Job::Start("b4mrl-tools",
                                             {"evaluate", "--json", "--agent", agent.path,
                                              "--environment", read->provenance.environment,
                                              "--episodes", fmt::format("{}", options_.episodes),
                                              "--seed", fmt::format("{}", options_.seed)},
                                             agent.result + ".log", std::move(claim)));
  Say(fmt::format("start {}", agent.path));
  active_.push_back({agent, std::move(job)});
  return true;
}

Status Evaluations::Collect() {
  for (auto active = active_.begin(); active != active_.end();) {
    const std::optional<int> exit_code = active->job.Poll();
    if (!exit_code) {
      ++active;
      continue;
    }
    if (*exit_code == 0) {
      B4MRL_RETURN_IF_ERROR(Keep(active->agent));
      ++summary_.done;
    } else {
      Fail(active->agent,
           fmt::format("ended with code {}, see {}.log", *exit_code, active->agent.result));
    }
    active = active_.erase(active);
  }
  return Status();
}

Status Evaluations::Keep(const Agent& agent) const {
  const std::string log = agent.result + ".log";
  B4MRL_ASSIGN_OR_RETURN(const std::string text, ReadSmallFile(log, kMaxOutput));
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(agent.result));
  // The JSON is the last line, behind what the command may have said of its daemon.
  const size_t line = text.size() < 2 ? std::string::npos : text.rfind('\n', text.size() - 2);
  B4MRL_RETURN_IF_ERROR(file.Write(line == std::string::npos ? text : text.substr(line + 1)));
  B4MRL_RETURN_IF_ERROR(file.Commit());
  std::error_code ignored;
  fs::remove(log, ignored);
  return Status();
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
