#include "benchmarks/records/learned.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <vector>

#include "benchmarks/records/json_file.h"
#include "data/d4rl/agent_file.h"
#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"
#include "proto/base/cores.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMostReturns = 10'000;
constexpr size_t kMostPoints = 10'000;  // of a curve

std::string LearnedPath(const std::string& folder) { return folder + "/learned.json"; }
std::string AgentPath(const std::string& folder) { return folder + "/agent.h5"; }
std::string ReturnsPath(const std::string& folder) { return folder + "/returns.json"; }
std::string CurvePath(const std::string& folder) { return folder + "/curve.json"; }
std::string AttemptsPath(const std::string& folder) { return folder + "/attempts.json"; }

bool Exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

Status NotUnderstood(const std::string& path, std::string_view allowed) {
  return Status(StatusCode::kDataLoss, fmt::format("{} must be {}", path, allowed));
}

// The returns of an object in a file of the learner's.
Result<std::vector<double>> ReturnsOf(const Json& json, const std::string& path) {
  auto returns = NumbersOf(json, "returns");
  if (!returns || returns->empty() || returns->size() > kMostReturns) {
    return NotUnderstood(
        path, fmt::format("an object with 1 to {} numbers as \"returns\"", kMostReturns));
  }
  const MeanAndStd figures = MeanAndStdOf(*returns);
  if (!std::isfinite(figures.mean) || !std::isfinite(figures.std)) {
    return NotUnderstood(path, "returns whose mean and deviation are finite");
  }
  return *std::move(returns);
}

// Adds the returns that the learner has measured itself.
Status AddOwnReturns(const std::string& path, const EnvironmentSpec& environment, Json* learned) {
  B4MRL_ASSIGN_OR_RETURN(const Json json, ReadJsonObject(path, kMaxOwnFileBytes));
  B4MRL_ASSIGN_OR_RETURN(const auto returns, ReturnsOf(json, path));
  if (!EntryOf(json, "updates").is_null()) {
    const auto updates = CountOf(json, "updates");
    if (!updates) return NotUnderstood(path, "an object with a whole number as \"updates\"");
    (*learned)["updates"] = *updates;
  }
  const MeanAndStd figures = MeanAndStdOf(returns);
  const auto score = environment.NormalisedScore(figures.mean);
  learned->update({{"source", "self-scored"},
                   {"returns", returns},
                   {"mean_return", figures.mean},
                   {"std_return", figures.std},
                   {"score", score ? Json(*score) : Json()}});
  return Status();
}

// Adds what the learner says that it has reached before its last update.
Status AddOwnCurve(const std::string& path, const EnvironmentSpec& environment, Json* learned) {
  B4MRL_ASSIGN_OR_RETURN(const Json json, ReadJsonObject(path, kMaxOwnFileBytes));
  const Json& points = EntryOf(json, "curve");
  if (!points.is_array() || points.size() > kMostPoints) {
    return NotUnderstood(
        path, fmt::format("an object with a list of up to {} points as \"curve\"", kMostPoints));
  }
  Curve curve;
  size_t episodes = 0;
  for (const Json& each : points) {
    const auto updates = CountOf(each, "updates");
    if (!updates || (!curve.empty() && *updates <= curve.back().updates)) {
      return NotUnderstood(path,
                           "a curve whose points have ascending whole numbers as \"updates\"");
    }
    B4MRL_ASSIGN_OR_RETURN(const auto returns, ReturnsOf(each, path));
    if (*updates >= CountOf(*learned, "updates")) break;  // the score of the last one is known
    const MeanAndStd figures = MeanAndStdOf(returns);
    curve.push_back({.updates = *updates,
                     .steps = CountOf(each, "steps").value_or(0),
                     .mean_return = figures.mean,
                     .std_return = figures.std,
                     .score = environment.NormalisedScore(figures.mean)});
    episodes += returns.size();
  }
  learned->update({{"curve", JsonOf(curve)}, {"curve_episodes", episodes}});
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

// What a learner's start has used, with what earlier ones have that brought no result.
Json WithAttempts(const PlannedRun& run, const std::string& folder, const LearnersUse& use) {
  double seconds = use.seconds;
  Json ledger = use.ledger;
  const auto earlier = ReadJsonObject(AttemptsPath(folder), kMaxOwnFileBytes);
  if (earlier.ok() && TextOf(*earlier, "learner_sha256") == LearnerHash(run)) {
    seconds += NumberOf(*earlier, "seconds").value_or(0);
    const Json& used = EntryOf(*earlier, "ledger");
    if (!used.is_object()) ledger = Json();  // a start that nobody could count
    for (const auto& [name, count] : ledger.items()) {
      ledger[name] = CountOf(ledger, name).value_or(0) + CountOf(used, name).value_or(0);
    }
  }
  return {{"learner_sha256", LearnerHash(run)}, {"seconds", seconds}, {"ledger", ledger}};
}

}  // namespace

bool HasAgent(const std::string& folder) { return Exists(AgentPath(folder)); }

std::string LearnerHash(const PlannedRun& run) { return Sha256OfText(run.learner); }

bool HasLearned(const PlannedRun& run, const std::string& folder,
                const std::string& columns_sha256) {
  const auto learned = ReadJsonObject(LearnedPath(folder), kMaxOwnFileBytes);
  return learned.ok() && TextOf(*learned, "learner_sha256") == LearnerHash(run) &&
         TextOf(*learned, "columns_sha256") == columns_sha256 &&
         CountOf(*learned, "planned_updates") >= run.updates &&
         (TextOf(*learned, "source") != "user" || HasAgent(folder));
}

std::optional<std::string> LearnedRows(const std::string& folder) {
  const auto learned = ReadJsonObject(LearnedPath(folder), kMaxOwnFileBytes);
  if (!learned.ok() || !EntryOf(*learned, "columns_sha256").is_string()) return std::nullopt;
  return TextOf(*learned, "columns_sha256");
}

void SetLearnedAside(const std::string& folder) {
  std::error_code ignored;
  for (const char* name : {"learned.json", "agent.h5", "returns.json", "curve.json"}) {
    std::filesystem::rename(fmt::format("{}/{}", folder, name),
                            fmt::format("{}/earlier-{}", folder, name), ignored);
  }
}

Result<std::string> KeepLearned(const PlannedRun& run, const std::string& folder,
                                const LearnersUse& use, const EnvironmentSpec& environment) {
  Json learned = WithAttempts(run, folder, use);
  learned.update({{"columns_sha256", use.columns_sha256},
                  {"planned_updates", run.updates},
                  {"updates", run.updates},
                  {"processor", ProcessorName()}});
  if (HasAgent(folder)) {
    B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(AgentPath(folder)));
    B4MRL_RETURN_IF_ERROR(CheckAgent(agent, environment, AgentPath(folder)));
    if (agent.provenance.updates > 0) learned["updates"] = agent.provenance.updates;
    learned["source"] = "user";
  } else if (Exists(ReturnsPath(folder))) {
    B4MRL_RETURN_IF_ERROR(AddOwnReturns(ReturnsPath(folder), environment, &learned));
  } else {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("left neither agent.h5 nor returns.json in {}", folder));
  }
  Status curve;
  if (Exists(CurvePath(folder))) curve = AddOwnCurve(CurvePath(folder), environment, &learned);
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(LearnedPath(folder), learned.dump() + "\n"));
  std::error_code ignored;
  std::filesystem::remove(AttemptsPath(folder), ignored);
  return curve.ok() ? std::string() : std::string(curve.message());
}

Status KeepAttempt(const PlannedRun& run, const std::string& folder, const LearnersUse& use) {
  return WriteSmallFile(AttemptsPath(folder), WithAttempts(run, folder, use).dump() + "\n");
}

Result<RunOutcome> OutcomeOfLearner(const std::string& folder) {
  RunOutcome outcome;
  if (!Exists(LearnedPath(folder))) return outcome;
  B4MRL_ASSIGN_OR_RETURN(const Json learned, ReadJsonObject(LearnedPath(folder), kMaxOwnFileBytes));
  outcome.ended = true;
  outcome.source = TextOf(learned, "source");
  outcome.ledger = EntryOf(learned, "ledger");
  outcome.processor = TextOf(learned, "processor");
  outcome.planned_updates = CountOf(learned, "planned_updates");
  outcome.learner_sha256 = TextOf(learned, "learner_sha256");
  if (outcome.source != "user" && outcome.source != "self-scored") {
    return NotUnderstood(LearnedPath(folder), "what the runner has written");
  }
  Json scored = learned;
  if (outcome.source == "user") {
    const std::string path = ScoringPath(folder, {.name = kOwnScoring});
    if (!Exists(path)) return outcome;
    B4MRL_ASSIGN_OR_RETURN(scored, ReadJsonObject(path, kMaxOwnFileBytes));
  }
  outcome.returns = EntryOf(scored, "returns");
  if (outcome.ledger.is_object()) {
    outcome.ledger["evaluation_episodes"] =
        outcome.returns.size() + CountOf(learned, "curve_episodes").value_or(0);
  }
  outcome.curve = ReadCurve(EntryOf(learned, "curve")).value_or(Curve());
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
