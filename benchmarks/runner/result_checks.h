// Checks results that others submit: their files (benchmarks/records/check.h), and their agents by
// scoring them again. Thread rule: one thread. An interrupt (client/interrupt.h) ends the work.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/records/check.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ResultCheckOptions {
  // A result, or a folder: of results, or one that holds "results/". Agents are looked for beside
  // them: files "*.h5" at any depth, known by their SHA-256; what is larger than an agent can be is
  // passed over.
  std::string path;
  uint32_t jobs = 1;
  std::string endpoint;  // of the daemon that scores the agents, which is to be of this version
  // An agent of a usual size plays the most episodes in a minute; a stranger's could take hours.
  int64_t scoring_deadline_ms = 600'000;
};

enum class AgentCheck {
  kAbsent,      // no agent lies beside the result
  kNotReached,  // it does, but an interrupt came before it was scored
  kScored,      // it was scored again, or could not be, which the faults say
};

struct CheckedResult {
  std::string path;
  std::vector<std::string> faults;  // none: the result is what it says, as far as `agent` tells
  AgentCheck agent = AgentCheck::kAbsent;
  std::string agreement;  // what is said of a sound result whose agent was scored
};

// In the order of the files' names. kUnavailable after an interrupt before the files were read and
// their agents found; kIoError if the folder cannot be read or written; evaluations
// are kept in the folder of temporary files.
Result<std::vector<CheckedResult>> CheckResults(const ResultCheckOptions& options,
                                                const CheckSources& sources);

}  // namespace b4mrl
