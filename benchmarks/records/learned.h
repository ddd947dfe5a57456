// What a learner of the user's own has left in its run's folder: "agent.h5", or "returns.json" with
// {"returns": [...], "updates": N}; and "learned.json", by which a run knows that it has ended.
// Any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// Keeps what a learner that ended with code 0 has left, the seconds that it took, and what it used
// (the entry "ledger" of a result).
// kFailedPrecondition if it has left nothing, kDataLoss if that cannot be understood or is an agent
// of another environment.
Status KeepLearned(const PlannedRun& run, const std::string& folder, double seconds,
                   const nlohmann::ordered_json& ledger, const EnvironmentSpec& environment);
// Whether KeepLearned has succeeded there, and whether the learner has left an agent.
bool HasLearned(const std::string& folder);
bool HasAgent(const std::string& folder);
// Without a curve while its agent was not evaluated.
Result<RunOutcome> OutcomeOfLearner(const std::string& folder);

}  // namespace b4mrl
