// Evaluates all agents of a folder, each once and in the world that it was trained for, by several
// processes at a time.
//
// An evaluation is the file DIR/evaluations/<first 16 digits of the agent's SHA-256>-e<episodes>-
// s<seed>.json, what `b4mrl evaluate --json` prints; a file of that name with ".claim" is locked by
// the process that makes it. So any number of programs, also on several machines that share the
// folder, evaluate no agent twice. Seed 0 has the starts of the evaluations during training; others
// are held out. Thread rule: one thread. An interrupt (client/interrupt.h) ends the work in order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct AgentEvaluationOptions {
  std::string folder;  // agents are its files "agent.h5" at any depth, and "*.h5" in it itself
  uint32_t jobs = 1;
  uint32_t episodes = 100;
  uint64_t seed = 1;
  std::string endpoint;  // of the daemon for all processes; "": each has a private one
  bool quiet = false;
};

struct AgentEvaluationSummary {
  size_t agents = 0;                // files of equal content count once
  size_t done = 0;                  // with an evaluation, earlier ones included
  std::vector<std::string> failed;  // "<path>: <reason>"
  bool interrupted = false;
};

// Returns when every agent has its evaluation or has failed; waits for those of other programs.
// kIoError if the folder cannot be read or written.
Result<AgentEvaluationSummary> EvaluateAgents(const AgentEvaluationOptions& options);

}  // namespace b4mrl
