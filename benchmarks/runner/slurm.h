// A suite on a cluster with Slurm: one array job, each task of which trains one run of plan.json.
//
// The job's batch script says what a task does: it saves its run at the time limit and has itself
// queued again, and goes on from the run's last checkpoint whenever Slurm starts it again. Tasks
// are told apart by the numbers of runs in plan.json and never by ids of jobs, which a Slurm
// controller that crashed gives a second time. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct SlurmJob {
  std::string folder;                       // of the runs, with plan.json; the script and logs/
  std::string time = "4:00:00";             // limit of a task, as sbatch reads it
  uint32_t parallel_tasks = 0;              // at a time; 0: no limit
  std::vector<std::string> sbatch_options;  // further ones, as "--partition=long"
  std::vector<std::string> command;         // of a task, without --index
};

// The job's name, by which a folder's tasks are found in Slurm's queue. kIoError.
Result<std::string> SlurmJobName(const std::string& folder);

// The job's batch script for the runs with these numbers, which ascend. kInvalidArgument for a
// folder or an option that cannot stand in a script; kIoError.
Result<std::string> BatchScript(const SlurmJob& job, const std::vector<uint64_t>& indices);

// Ascending numbers as Slurm's lists have them: "0-3,7".
std::string CompactList(const std::vector<uint64_t>& indices);

// The folder's runs that tasks in Slurm's queue are to train or are training. kFailedPrecondition
// without squeue, kUnavailable if it fails.
Result<std::set<uint64_t>> QueuedIndices(const std::string& folder);

// Submits a script; returns the job's id. Errors as above, of sbatch.
Result<std::string> SubmitScript(const std::string& path);

}  // namespace b4mrl
