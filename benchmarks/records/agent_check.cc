#include "benchmarks/records/agent_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "algorithms/policy/observation_mask.h"
#include "benchmarks/plan/perturbation_names.h"
#include "benchmarks/records/json_file.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

// For the comparison of means. Fewer episodes say too little of how much they vary.
constexpr size_t kLeastEpisodes = 10;
constexpr double kStandardErrors = 4;
// Of the mean: for tasks whose episodes hardly vary.
constexpr double kLeastChance = 1e-3;

class AgentChecker {
 public:
  AgentChecker(const Agent& agent, const Json& result, const CheckSources& sources)
      : agent_(agent), result_(result), sources_(sources) {}

  Result<std::vector<std::string>> Check();

 private:
  // Perturbations may be presets: "hidden-high" is "hidden=9".
  std::string Spelled(const std::string& perturbations) const;
  void CheckText(std::string_view what, const std::string& said, const std::string& must_be);
  void CheckCount(std::string_view what, uint64_t said, std::string_view key);
  Status CheckMask();

  const Agent& agent_;
  const Json& result_;
  const CheckSources& sources_;
  const bool is_own_ = TextOf(result_, "source") == "own";
  std::vector<std::string> faults_;
};

std::string AgentChecker::Spelled(const std::string& perturbations) const {
  const auto spelled =
      Parametric(perturbations, TextOf(result_, "environment"), *sources_.plan.catalogue);
  return spelled.ok() ? *spelled : perturbations;
}

void AgentChecker::CheckText(std::string_view what, const std::string& said,
                             const std::string& must_be) {
  if (said == must_be || (said.empty() && !is_own_)) return;
  faults_.push_back(fmt::format("its agent has the {} '{}', the result '{}'", what, said, must_be));
}

void AgentChecker::CheckCount(std::string_view what, uint64_t said, std::string_view key) {
  const auto must_be = CountOf(result_, key);
  if (said == must_be || (said == 0 && !is_own_)) return;
  faults_.push_back(fmt::format("its agent has the {} {}, the result {}", what, said,
                                EntryOf(result_, key).dump()));
}

Status AgentChecker::CheckMask() {
  B4MRL_ASSIGN_OR_RETURN(const PlannedRun run, RunOfResult(result_, sources_));
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec environment,
                         sources_.find_environment(run.environment));
  B4MRL_ASSIGN_OR_RETURN(const auto hidden, ParseNamedArguments(run.hidden));
  B4MRL_ASSIGN_OR_RETURN(const auto mask, MaskOfPerturbations(environment.observation, hidden));
  for (size_t i = 0; i < mask.size(); ++i) {
    const bool is_seen = i >= agent_.observation_mask.size() || agent_.observation_mask[i] != 0;
    if (mask[i] != 0 || !is_seen) continue;
    faults_.push_back(fmt::format("its agent sees dimension {}, which was hidden from it", i));
  }
  return Status();
}

Result<std::vector<std::string>> AgentChecker::Check() {
  const AgentProvenance& said = agent_.provenance;
  const Json& dataset = EntryOf(result_, "dataset");
  CheckText("environment", said.environment, TextOf(result_, "environment"));
  CheckText("dataset", said.dataset, TextOf(dataset, "name"));
  CheckText("dataset's SHA-256", said.dataset_sha256, TextOf(dataset, "sha256"));
  CheckText("corruption", Spelled(said.corruption), Spelled(TextOf(result_, "corruption")));
  CheckText("simulator", Spelled(said.simulator), Spelled(TextOf(result_, "simulator")));
  CheckText("world", Spelled(said.world), Spelled(TextOf(result_, "world")));
  CheckCount("updates", said.updates, "updates");
  if (is_own_) {
    CheckText("algorithm", said.algorithm, TextOf(result_, "algorithm"));
    CheckCount("seed", said.seed, "seed");
    CheckCount("history", agent_.history_length, "history");
    B4MRL_RETURN_IF_ERROR(CheckMask());
  }
  return std::move(faults_);
}

bool IsScoredByEvaluate(const Json& result) {
  return TextOf(result, "source") == "own" || !TextOf(result, "budget").empty();
}

}  // namespace

size_t EpisodesToCompare(const Json& result) {
  const size_t episodes = NumbersOf(result, "returns").value_or(std::vector<double>()).size();
  if (episodes == 0 || IsScoredByEvaluate(result)) return episodes;
  return std::max(episodes, kLeastEpisodes);
}

ComparedReturns CompareReturns(const Json& evaluation, const Json& result) {
  const auto ours = NumbersOf(evaluation, "returns"), theirs = NumbersOf(result, "returns");
  if (ours && ours == theirs) return {true, "its agent has these returns"};
  const bool have_means = ours && theirs && ours->size() > 1 && !theirs->empty();
  if (IsScoredByEvaluate(result) || !have_means) {
    return {false,
            fmt::format("its agent has the returns {}, not {}",
                        EntryOf(evaluation, "returns").dump(), EntryOf(result, "returns").dump())};
  }
  const MeanAndStd own = MeanAndStdOf(*ours);
  const double mean = MeanAndStdOf(*theirs).mean;
  const auto n = static_cast<double>(ours->size()), m = static_cast<double>(theirs->size());
  const double error = own.std * std::sqrt(n / (n - 1) * (1 / n + 1 / m));
  const double chance = std::max(kStandardErrors * error, kLeastChance * std::abs(own.mean));
  return {std::abs(mean - own.mean) <= chance,
          fmt::format("its agent has the mean return {:.6g}, the result {:.6g}; up to {:.3g} apart "
                      "is chance",
                      own.mean, mean, chance)};
}

Result<std::vector<std::string>> AgentFaults(const Agent& agent, const Json& result,
                                             const CheckSources& sources) {
  return AgentChecker(agent, result, sources).Check();
}

}  // namespace b4mrl
