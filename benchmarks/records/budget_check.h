// Whether the budget and the recipe of a result are names for what it says it was trained with. Any
// thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "benchmarks/records/check.h"

namespace b4mrl {

// One line for each fault. Results of the user's own learners have none, nor have those of which no
// benchmark is known; names that no budget of the project has may stand for anything.
std::vector<std::string> BudgetFaults(const nlohmann::ordered_json& result,
                                      const CheckSources& sources);

}  // namespace b4mrl
