// Training a run as a job: by `b4mrl train`, or by a learner of the user's own. Pure functions, but
// for the variables of this process that LearnerOrder reads; any thread.
//
// A learner of the user's own is a command of the shell. It gets these variables: B4MRL_ENDPOINT
// (of a daemon for it), B4MRL_BENCHMARK, B4MRL_ENVIRONMENT, B4MRL_SIMULATOR, B4MRL_DATASET,
// B4MRL_CORRUPTION, B4MRL_WORLD (perturbations of the true environment, in which it will be
// scored), B4MRL_SEED, B4MRL_UPDATES, B4MRL_LEDGER (where its interactions are to be counted),
// B4MRL_SUITES (folder of further suites) and B4MRL_OUT, the folder in which it leaves what
// benchmarks/records/learned.h reads; what an earlier attempt has left of these files is removed
// before. OMP_NUM_THREADS, OPENBLAS_NUM_THREADS and MKL_NUM_THREADS are 1 unless this process has
// other values of them. An exit code other than 0 is a failure.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "benchmarks/jobs/job.h"
#include "benchmarks/plan/budget.h"
#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"

namespace b4mrl {

// How far a run with this result is to be trained: for its updates, and for as many again, at most
// so often, while it has not settled.
uint64_t UpdatesToTrain(const PlannedRun& run, const std::optional<RunResult>& result,
                        uint32_t until_settled);

// `updates`: to train for, at least the run's own number. `daemon_words`: options of the command
// that choose its daemon.
JobOrder TrainingOrder(const PlannedRun& run, const Budget& budget, uint64_t updates,
                       const std::string& folder, const std::vector<std::string>& daemon_words);

struct LearnerPlace {
  std::string endpoint;  // of the daemon
  std::string suites;    // folder of further suites; "": none
  uint64_t ledger = 0;
};
JobOrder LearnerOrder(const PlannedRun& run, const std::string& folder, const LearnerPlace& place);

}  // namespace b4mrl
