// Whether an agent is the one that its result says: its file says what trained it on what.
// Pure functions; any thread.
#pragma once

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

}  // namespace b4mrl
