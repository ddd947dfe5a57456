// An evaluation as a job: `b4mrl evaluate --json`, whose printed JSON becomes a file. One thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/runner/job.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

struct EvaluationOrder {
  std::string agent;  // path
  std::string environment;
  std::string simulator;            // perturbations; "": the true environment
  std::string observe = "trained";  // or "full"
  uint32_t episodes = 10;
  std::vector<std::string> daemon_words;  // options that choose its daemon
  uint64_t seed = 0;  // of the starts; 0 has those of the evaluations during training
};

// Starts the evaluation. Its output goes to `result` + ".log" until KeepEvaluation.
Result<Job> StartEvaluation(const EvaluationOrder& order, const std::string& result,
                            UniqueFd claim);
// Makes the file `result` of the output of an evaluation that ended with code 0.
Status KeepEvaluation(const std::string& result);

}  // namespace b4mrl
