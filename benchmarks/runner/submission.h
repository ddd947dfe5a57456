// Hands the runs of a plan to Slurm that have no result yet and are not in its queue.
// Thread rule: one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/plan/plan.h"
#include "benchmarks/runner/slurm.h"
#include "proto/base/status.h"

namespace b4mrl {

struct SubmissionOptions {
  SlurmJob job;                // of every block; its parallel tasks are those of all together
  std::string results;         // folder of the results
  uint32_t until_settled = 0;  // how often runs that have not settled go on (runner.h)
  bool retry = false;          // diverged runs, too
  bool dry_run = false;        // write the plan and the scripts, print these and submit nothing
};

// Says on stderr how many runs are done, queued and to be submitted, and on stdout the jobs, or the
// scripts of a dry run. Errors: those of plan.json (frozen_plan.h), of Slurm and of scripts
// (slurm.h), kIoError.
Status SubmitMissingRuns(const std::vector<PlannedRun>& plan, const SubmissionOptions& options);

}  // namespace b4mrl
