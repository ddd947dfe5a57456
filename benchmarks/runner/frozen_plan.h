// The list of a suite's runs as a file, to which tasks of a cluster refer by number. Any process;
// one thread a call.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "benchmarks/plan/plan.h"
#include "proto/base/status.h"

namespace b4mrl {

// Reads DIR/plan.json, the frozen list of the runs' ids, and writes it first if there is none.
// kIoError; kDataLoss if the file is no such list.
Result<std::vector<std::string>> FreezePlan(const std::string& folder,
                                            const std::vector<PlannedRun>& plan);
// The list as it is; empty if there is none. kDataLoss as above.
Result<std::vector<std::string>> ReadFrozenPlan(const std::string& folder);
// The numbers of the runs in the frozen list. kFailedPrecondition if it lacks one of them.
Result<std::vector<uint64_t>> IndicesOf(const std::vector<PlannedRun>& plan,
                                        const std::vector<std::string>& frozen);
// The run with this number in the frozen list. kInvalidArgument for another number;
// kFailedPrecondition if `plan` lacks that run: the command's patterns are not those of the list.
Result<PlannedRun> FindByIndex(const std::vector<std::string>& frozen, uint64_t index,
                               const std::vector<PlannedRun>& plan);

}  // namespace b4mrl
