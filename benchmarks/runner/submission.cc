#include "benchmarks/runner/submission.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <set>

#include "algorithms/base/progress.h"
#include "benchmarks/runner/frozen_plan.h"
#include "benchmarks/runner/plan_status.h"
#include "data/files/atomic_file.h"
#include "data/files/make_folder.h"

namespace b4mrl {
namespace {

// Submits a job for each block, or prints the scripts of a dry run.
Status SubmitBlocks(const std::vector<RunBlock>& blocks, const SubmissionOptions& options) {
  if (blocks.empty()) return Status();
  SlurmJob job = options.job;
  const auto jobs = static_cast<uint32_t>(blocks.size());
  const uint32_t tasks = options.job.parallel_tasks;  // of all blocks together
  if (tasks > 0 && tasks < jobs) {
    Tell(
        fmt::format("{} tasks at a time instead of {}: one of each job, of which there are as "
                    "many because the cluster bounds their size\n",
                    jobs, tasks));
  }
  B4MRL_RETURN_IF_ERROR(MakeFolder(job.folder + "/logs"));
  for (uint32_t i = 0; i < jobs; ++i) {
    const RunBlock& block = blocks[i];
    if (tasks > 0) job.parallel_tasks = std::max(1u, tasks / jobs + (i < tasks % jobs ? 1 : 0));
    B4MRL_ASSIGN_OR_RETURN(const std::string script, BatchScript(job, block));
    const std::string path = job.folder + "/" + ScriptName(block);
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(path, script));
    if (options.dry_run) {
      fmt::print("{}", script);
      continue;
    }
    B4MRL_ASSIGN_OR_RETURN(const std::string id, SubmitScript(path, job.sbatch_options));
    fmt::print("job {}: {} runs; tasks' messages in {}/logs\n", id, block.indices.size(),
               job.folder);
  }
  return Status();
}

}  // namespace

Status SubmitMissingRuns(const std::vector<PlannedRun>& plan, const SubmissionOptions& options) {
  const std::string& folder = options.job.folder;
  B4MRL_ASSIGN_OR_RETURN(const auto frozen, FreezePlan(folder, plan));
  B4MRL_ASSIGN_OR_RETURN(const auto indices, IndicesOf(plan, frozen));
  std::set<uint64_t> queued;
  const Result<uint64_t> array_size = MaxArraySize();
  if (!options.dry_run) {
    B4MRL_RETURN_IF_ERROR(array_size.status());
    B4MRL_ASSIGN_OR_RETURN(queued, QueuedIndices(folder, frozen.size(), *array_size));
  }
  // Behind the look at the queue: what has left it by now is done, or is submitted.
  const PlanStatus status = StatusOf(plan, folder, options.results, options.until_settled);
  std::vector<uint64_t> left;
  size_t in_queue = 0;
  for (size_t i = 0; i < plan.size(); ++i) {
    const RunProgress progress = status.runs[i].progress;
    if (progress == RunProgress::kDone) continue;
    if (progress == RunProgress::kDiverged && !options.retry) continue;
    if (queued.contains(indices[i])) {
      ++in_queue;
    } else {
      left.push_back(indices[i]);
    }
  }
  std::ranges::sort(left);
  Tell(fmt::format("{} of {} runs done, {} in the queue, {} to be submitted\n",
                   status.CountOf(RunProgress::kDone), plan.size(), in_queue, left.size()));
  return SubmitBlocks(BlocksOf(left, array_size.ok() ? *array_size : kUsualArraySize), options);
}

}  // namespace b4mrl
