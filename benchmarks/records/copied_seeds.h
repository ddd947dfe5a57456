// One seed's result that stands for another's: seeds of a cell whose agents or curves are equal.
// Pure function; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace b4mrl {

// For each result the faults that the results before it make evident, one line each; `names` are
// what these are called.
std::vector<std::vector<std::string>> CopiedSeeds(
    const std::vector<nlohmann::ordered_json>& results, const std::vector<std::string>& names);

}  // namespace b4mrl
