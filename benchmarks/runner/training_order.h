// Training a run as a job: the words of `b4mrl train`. Pure function; any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/runner/budget.h"
#include "benchmarks/runner/job.h"
#include "benchmarks/runner/plan.h"

namespace b4mrl {

// `updates`: to train for, at least the run's own number. `daemon_words`: options of the command
// that choose its daemon.
JobOrder TrainingOrder(const PlannedRun& run, const Budget& budget, uint64_t updates,
                       const std::string& folder, const std::vector<std::string>& daemon_words);

}  // namespace b4mrl
