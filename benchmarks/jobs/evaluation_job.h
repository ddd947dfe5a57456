// An evaluation as a job: `b4mrl evaluate --json`, whose printed JSON becomes a file. One thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/jobs/job.h"
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

// Where the evaluation's output goes until KeepEvaluation.
std::string LogOfEvaluation(const std::string& result);
// Starts the evaluation.
Result<Job> StartEvaluation(const EvaluationOrder& order, const std::string& result,
                            UniqueFd claim);
// Makes the file `result` of the output of an evaluation that ended with code 0. kIoError;
// kDataLoss if the output holds no evaluation's JSON.
Status KeepEvaluation(const std::string& result);

}  // namespace b4mrl
