#include "benchmarks/records/scoring_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "benchmarks/plan/perturbation_names.h"
#include "benchmarks/records/json_file.h"
#include "proto/base/mean_and_std.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kTolerance = 1e-6;

// What is wrong with the scoring; "": nothing is.
std::string FaultOf(const Json& entry, const Scoring& scoring, const std::string& environment,
                    const CheckSources& sources) {
  const std::string observe = TextOf(entry, "observe");
  if (observe != scoring.observe) {
    return fmt::format("observe is '{}', must be '{}'", observe, scoring.observe);
  }
  const std::string simulator = TextOf(entry, "simulator");
  const auto own = Parametric(simulator, environment, *sources.plan.catalogue);
  const auto must_be = Parametric(scoring.simulator, environment, *sources.plan.catalogue);
  if (!own.ok() || !must_be.ok() || *own != *must_be) {
    return fmt::format("simulator is '{}', must be '{}'", simulator, scoring.simulator);
  }
  const auto returns = NumbersOf(entry, "returns");
  if (!returns || returns->empty()) return "returns must be a list of numbers";
  const double mean = MeanAndStdOf(*returns).mean;
  if (!Agree(NumberOf(entry, "return"), mean)) {
    return fmt::format("return is {}, the returns make it {}", EntryOf(entry, "return").dump(),
                       mean);
  }
  const auto spec = sources.find_environment(environment);
  if (spec.ok() && !Agree(NumberOf(entry, "score"), spec->NormalisedScore(mean))) {
    return fmt::format("score is {}, which is not that of the returns",
                       EntryOf(entry, "score").dump());
  }
  return "";
}

}  // namespace

bool Agree(const std::optional<double>& number, const std::optional<double>& must_be) {
  return number.has_value() == must_be.has_value() &&
         (!number ||
          std::abs(*number - *must_be) <= kTolerance * std::max(1.0, std::abs(*must_be)));
}

std::vector<std::string> ScoringFaults(const Json& result, const PlannedRun& run,
                                       const CheckSources& sources) {
  const Json& scorings = EntryOf(result, "scorings");
  if (scorings.is_null()) return {};
  if (!scorings.is_object()) return {"scorings must be an object"};
  std::vector<std::string> faults;
  for (const auto& [name, entry] : scorings.items()) {
    const auto scoring = std::ranges::find(run.scorings, name, &Scoring::name);
    if (scoring == run.scorings.end()) {
      return {fmt::format("scorings has '{}', which such a run does not have", name)};
    }
    const std::string fault = FaultOf(entry, *scoring, run.environment, sources);
    if (!fault.empty()) faults.push_back(fmt::format("scorings.{}.{}", name, fault));
  }
  return faults;
}

}  // namespace b4mrl
