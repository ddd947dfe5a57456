// Whether an agent is the one that its result says: its file says what trained it on what.
// Pure functions; any thread.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "benchmarks/records/check.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// What the agent says otherwise than its result, one line each. An agent of the project says
// everything and does not see what its training hid. A user's own says of its data, its simulator
// and its updates what it likes; it is scored without what its benchmark hides. Errors as of
// RunOfResult.
Result<std::vector<std::string>> AgentFaults(const Agent& agent,
                                             const nlohmann::ordered_json& result,
                                             const CheckSources& sources);

// How many episodes of an agent are to be evaluated, for CompareReturns; 0 where its result has no
// returns.
size_t EpisodesToCompare(const nlohmann::ordered_json& result);

struct ComparedReturns {
  bool agree = false;
  std::string words;  // "its agent has these returns"
};
// Compares the evaluation of an agent, as `b4mrl evaluate --json` prints it, with its result. Where
// `b4mrl evaluate` has scored the result, as in every run of `b4mrl benchmark run`, which names its
// budget, the returns must be equal. Python's `bench.record` names none: its policies act by NumPy
// or PyTorch, whose actions differ in the last bits, and in a chaotic task all returns then differ.
// The means of such results must be equal within four standard errors of their difference, by what
// the evaluation's episodes vary: the result's own could be made to vary at will.
ComparedReturns CompareReturns(const nlohmann::ordered_json& evaluation,
                               const nlohmann::ordered_json& result);

}  // namespace b4mrl
