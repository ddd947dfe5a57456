#include "benchmarks/records/learned.h"

#include <fmt/format.h>

#include <filesystem>
#include <string_view>
#include <system_error>
#include <vector>

#include "benchmarks/records/json_file.h"
#include "data/d4rl/agent_file.h"
#include "data/files/atomic_file.h"
#include "proto/base/cores.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMostReturns = 10'000;

std::string LearnedPath(const std::string& folder) { return folder + "/learned.json"; }
std::string AgentPath(const std::string& folder) { return folder + "/agent.h5"; }

bool Exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

Status NotUnderstood(const std::string& path, std::string_view allowed) {
  return Status(StatusCode::kDataLoss, fmt::format("{} must be {}", path, allowed));
}

// Adds the returns that the learner has measured itself.
Status AddOwnReturns(const std::string& path, const EnvironmentSpec& environment, Json* learned) {
  B4MRL_ASSIGN_OR_RETURN(const Json json, ReadJsonObject(path));
  const auto returns = NumbersOf(json, "returns");
  if (!returns || returns->empty() || returns->size() > kMostReturns) {
    return NotUnderstood(
        path, fmt::format("an object with 1 to {} numbers as \"returns\"", kMostReturns));
  }
  if (!EntryOf(json, "updates").is_null()) {
    const auto updates = CountOf(json, "updates");
    if (!updates) return NotUnderstood(path, "an object with a whole number as \"updates\"");
    (*learned)["updates"] = *updates;
  }
  const MeanAndStd figures = MeanAndStdOf(*returns);
  const auto score = environment.NormalisedScore(figures.mean);
  learned->update({{"source", "self-scored"},
                   {"returns", *returns},
                   {"mean_return", figures.mean},
                   {"std_return", figures.std},
                   {"score", score ? Json(*score) : Json()}});
  return Status();
}

// Refuses an agent that cannot act in the environment, or says that it was meant for another.
Status CheckAgent(const Agent& agent, const EnvironmentSpec& environment, const std::string& path) {
  const std::string& meant_for = agent.provenance.environment;
  if (agent.observation_dimensions == environment.observation.size() &&
      agent.action_dimensions == environment.action.size() &&
      (meant_for.empty() || meant_for == environment.name)) {
    return Status();
  }
  return NotUnderstood(
      path, fmt::format("an agent of {}, with {} observation and {} action dimensions; it is one "
                        "of '{}' with {} and {}",
                        environment.name, environment.observation.size(), environment.action.size(),
                        meant_for, agent.observation_dimensions, agent.action_dimensions));
}

}  // namespace

bool HasLearned(const std::string& folder) { return Exists(LearnedPath(folder)); }
bool HasAgent(const std::string& folder) { return Exists(AgentPath(folder)); }

Status KeepLearned(const PlannedRun& run, const std::string& folder, double seconds,
                   const Json& ledger, const EnvironmentSpec& environment) {
  Json learned = {{"updates", run.updates},
                  {"seconds", seconds},
                  {"ledger", ledger},
                  {"processor", ProcessorName()}};
  const std::string returns = folder + "/returns.json";
  if (HasAgent(folder)) {
    B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(AgentPath(folder)));
    B4MRL_RETURN_IF_ERROR(CheckAgent(agent, environment, AgentPath(folder)));
    if (agent.provenance.updates > 0) learned["updates"] = agent.provenance.updates;
    learned["source"] = "user";
  } else if (Exists(returns)) {
    B4MRL_RETURN_IF_ERROR(AddOwnReturns(returns, environment, &learned));
  } else {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("left neither agent.h5 nor returns.json in {}", folder));
  }
  return WriteSmallFile(LearnedPath(folder), learned.dump() + "\n");
}

Result<RunOutcome> OutcomeOfLearner(const std::string& folder) {
  RunOutcome outcome;
  if (!HasLearned(folder)) return outcome;
  B4MRL_ASSIGN_OR_RETURN(const Json learned, ReadJsonObject(LearnedPath(folder)));
  outcome.ended = true;
  outcome.source = TextOf(learned, "source");
  outcome.ledger = EntryOf(learned, "ledger");
  outcome.processor = TextOf(learned, "processor");
  if (outcome.source != "user" && outcome.source != "self-scored") {
    return NotUnderstood(LearnedPath(folder), "what the runner has written");
  }
  Json scored = learned;
  if (outcome.source == "user") {
    const std::string path = ScoringPath(folder, {.name = kOwnScoring});
    if (!Exists(path)) return outcome;
    B4MRL_ASSIGN_OR_RETURN(scored, ReadJsonObject(path));
  }
  outcome.returns = EntryOf(scored, "returns");
  if (outcome.ledger.is_object()) {
    outcome.ledger["evaluation_episodes"] = outcome.source == "user" ? outcome.returns.size() : 0;
  }
  CurvePoint point;
  point.updates = CountOf(learned, "updates").value_or(0);
  point.steps = CountOf(outcome.ledger, "simulator_steps").value_or(0);
  point.seconds = NumberOf(learned, "seconds").value_or(0);
  point.mean_return = NumberOf(scored, "mean_return").value_or(0);
  point.std_return = NumberOf(scored, "std_return").value_or(0);
  point.score = NumberOf(scored, "score");
  outcome.curve.push_back(point);
  return outcome;
}

}  // namespace b4mrl
