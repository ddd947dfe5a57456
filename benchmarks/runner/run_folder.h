// The folders of a suite's runs, the mark "failed.json" of a run that diverged, and "error.json" of
// one that was given up. Thread rule: one thread, which holds the run's claim where it writes.
#pragma once

#include <string>

#include "algorithms/run/run_result.h"
#include "benchmarks/plan/plan.h"
#include "proto/base/status.h"

namespace b4mrl {

// DIR/runs/<name>-<first 8 digits of the id>.
std::string RunFolder(const std::string& folder, const PlannedRun& run);
// DIR/datasets/HalfCheetah-medium-v0: the claim and the log of a dataset's making, without their
// extensions.
std::string DatasetStem(const std::string& folder, std::string dataset);

// Removes what only a run that goes on needs: replay memory, ensemble, checkpoints. Leaves it where
// `b4mrl train` was stopped, on its way to more updates than the run's result has.
void RemoveTraining(const std::string& folder);
// Removes what says how far a training has come, before another one begins from its first update:
// no result may be written of it any more. Its agent, of which there may be a result, is kept under
// the name "agent-<updates>.h5" if the training was finished.
void RemoveProgress(const std::string& folder);
// Removes the scorings of the agent that is about to be trained further, or anew.
void RemoveScorings(const PlannedRun& run, const std::string& folder);

// failed.json holds why and after how many updates the run diverged. kIoError.
Status MarkDiverged(const std::string& folder, const RunStatus& state);
bool IsMarkedDiverged(const std::string& folder);
// error.json holds why a runner gave the run up, for whoever asks how far it is; the run is begun
// again all the same. What cannot be written is left out.
void KeepFailure(const std::string& folder, const std::string& reason);
void RemoveFailure(const std::string& folder);
// "" if it was not given up.
std::string FailureOf(const std::string& folder);
// Removes a diverged run, but not its claim, which is held. kBusy while somebody trains there.
Status RemoveDiverged(const std::string& folder);

}  // namespace b4mrl
