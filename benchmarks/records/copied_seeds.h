// One seed's result that stands for another's: seeds of a cell whose agents or curves are equal.
// Pure functions; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace b4mrl {

// What CopiedSeeds looks at, of a result: its cell, seed and agent's hash, and a hash for its
// curve. Small, whatever the result holds.
nlohmann::ordered_json SeedMarks(const nlohmann::ordered_json& result);

// For each result the faults that the results before it make evident, one line each; `names` are
// what these are called. Results may be given by their marks.
std::vector<std::vector<std::string>> CopiedSeeds(
    const std::vector<nlohmann::ordered_json>& results, const std::vector<std::string>& names);

}  // namespace b4mrl
