// Whether the further scores of a result's agent, which decide nothing but are shown, are what they
// say. Pure functions; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "benchmarks/records/check.h"

namespace b4mrl {

// Whether a number of a result is what its other entries make it. Logs keep nine digits. Null on
// both sides agrees, too.
bool Agree(const std::optional<double>& number, const std::optional<double>& must_be);

// What is wrong with the scorings of a result, one line each. `run` is the result's, which says
// which scorings it may have; some may be missing.
std::vector<std::string> ScoringFaults(const nlohmann::ordered_json& result, const PlannedRun& run,
                                       const CheckSources& sources);

}  // namespace b4mrl
