// A suite on a cluster with Slurm: an array job, each task of which trains one run of plan.json.
//
// A cluster bounds the numbers that a job's tasks may have. Where plan.json is longer, there is a
// job for each block of so many runs, whose tasks count from the block's first run.
//
// The job's batch script says what a task does: it saves its run at the time limit and has itself
// queued again, and goes on from the run's last checkpoint whenever Slurm starts it again. Tasks
// are told apart by the numbers of runs in plan.json and never by ids of jobs, which a Slurm
// controller that crashed gives a second time. So a block's name says its first run. Thread rule:
// one thread.
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

// A job's name, by which the tasks of a folder and a block are found in Slurm's queue. kIoError.
Result<std::string> SlurmJobName(const std::string& folder, uint64_t first_run = 0);

// How many tasks one job may have, and below which number: the cluster's MaxArraySize, or its
// scheduler's max_array_tasks if that is less. Errors as of QueuedIndices, of scontrol; kDataLoss
// if it does not say a whole number above 0.
Result<uint64_t> MaxArraySize();
inline constexpr uint64_t kUsualArraySize = 1001;  // without a line in slurm.conf

// Runs whose numbers one job's tasks can have.
struct RunBlock {
  uint64_t first_run = 0;         // of the block; a multiple of the array size
  std::vector<uint64_t> indices;  // of the runs to be submitted, ascending
};
// Ascending numbers in blocks, without those that would be empty.
std::vector<RunBlock> BlocksOf(const std::vector<uint64_t>& indices, uint64_t array_size);

// The name of a block's batch script: "slurm.sh", "slurm+1001.sh".
std::string ScriptName(const RunBlock& block);

// The batch script for the runs of a block. kInvalidArgument for a folder or an option that cannot
// stand in a script; kIoError.
Result<std::string> BatchScript(const SlurmJob& job, const RunBlock& block);

// Ascending numbers as Slurm's lists have them: "0-3,7".
std::string CompactList(const std::vector<uint64_t>& indices);

// Those of the folder's first `runs` runs that tasks in Slurm's queue are to train or are training,
// in blocks of this size. kFailedPrecondition without squeue, kInternal if it fails.
Result<std::set<uint64_t>> QueuedIndices(const std::string& folder, uint64_t runs,
                                         uint64_t array_size);

// Submits a script that has these further options; returns the job's id. sbatch prefers its
// variables (SBATCH_PARTITION) to what a script says, so it does not get those of the script's own
// options and of these. Errors as above, of sbatch.
Result<std::string> SubmitScript(const std::string& path,
                                 const std::vector<std::string>& sbatch_options);

}  // namespace b4mrl
