// Learners of the user's own in a suite: a command of the shell that trains through B4MRL's client
// and leaves an agent, or returns that it has measured itself.
//
// The command gets these variables: B4MRL_ENDPOINT (of a daemon for it), B4MRL_BENCHMARK,
// B4MRL_ENVIRONMENT, B4MRL_SIMULATOR, B4MRL_DATASET, B4MRL_CORRUPTION, B4MRL_WORLD (perturbations
// of the true environment, in which it will be scored), B4MRL_SEED, B4MRL_UPDATES, B4MRL_LEDGER
// (where its interactions are to be counted), B4MRL_SUITES (folder of further suites) and
// B4MRL_OUT, a folder in which it leaves "agent.h5", or "returns.json": {"returns": [...],
// "updates": N}. An exit code other than 0 is a failure. Any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "benchmarks/runner/job.h"
#include "benchmarks/runner/plan.h"
#include "benchmarks/runner/result_file.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct LearnerPlace {
  std::string endpoint;  // of the daemon
  std::string suites;    // folder of further suites; "": none
  uint64_t ledger = 0;
};

JobOrder LearnerOrder(const PlannedRun& run, const std::string& folder, const LearnerPlace& place);

// Keeps what a learner that ended with code 0 has left, the seconds that it took, and what it used
// (the entry "ledger" of a result).
// kFailedPrecondition if it has left nothing, kDataLoss if that cannot be understood.
Status KeepLearned(const PlannedRun& run, const std::string& folder, double seconds,
                   const nlohmann::ordered_json& ledger, const EnvironmentSpec& environment);
// Whether KeepLearned has succeeded there, and whether the learner has left an agent.
bool HasLearned(const std::string& folder);
bool HasAgent(const std::string& folder);
// Without a curve while its agent was not evaluated.
Result<RunOutcome> OutcomeOfLearner(const std::string& folder);

}  // namespace b4mrl
