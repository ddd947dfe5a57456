// What a learner of the user's own has left in its run's folder: "agent.h5", or "returns.json" with
// {"returns": [...], "updates": N}; if it likes, "curve.json" with what it reached before its last
// update, {"curve": [{"updates": N, "returns": [...]}, ...]}, each with "steps" if it counts those
// of its simulator; and "learned.json", by which a run knows that it has ended. Any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// What a learner's start has used.
struct LearnersUse {
  double seconds = 0;
  nlohmann::ordered_json ledger;  // the entry "ledger" of a result; null: nobody could count it
  std::string columns_sha256;     // of the rows of its dataset as it began; "" without a dataset
};

// Keeps what a learner that ended with code 0 has left, and what it used, with what KeepAttempt has
// kept. Returns why its curve was left out, which is only to be looked at and not worth the
// training; "" where it was not. kFailedPrecondition if the learner has left nothing, kDataLoss if
// that cannot be understood or is an agent of another environment.
Result<std::string> KeepLearned(const PlannedRun& run, const std::string& folder,
                                const LearnersUse& use, const EnvironmentSpec& environment);
// Adds up what starts of the learner's command have used that brought no result, because they were
// cut off or failed: the next one may go on from what they have left. A start whose runner was
// killed with it is lost.
Status KeepAttempt(const PlannedRun& run, const std::string& folder, const LearnersUse& use);
// Whether KeepLearned has succeeded there for the run's command, these rows and as many updates as
// it is to do, and the agent that it kept, if any, is still there; whether the learner has left an
// agent.
bool HasLearned(const PlannedRun& run, const std::string& folder,
                const std::string& columns_sha256);
bool HasAgent(const std::string& folder);
// The hash of the rows that KeepLearned was told of there; nothing where it has kept nothing.
std::optional<std::string> LearnedRows(const std::string& folder);
// Renames what an earlier attempt has left of these files, "agent.h5" to "earlier-agent.h5", and
// nothing else that a learner may keep there to go on from. It may have ended well, with its runner
// killed or the disk full.
void SetLearnedAside(const std::string& folder);
// By which results know the command of the run's learner: the SHA-256 of its text.
std::string LearnerHash(const PlannedRun& run);
// Without a curve while its agent was not evaluated.
Result<RunOutcome> OutcomeOfLearner(const std::string& folder);

}  // namespace b4mrl
