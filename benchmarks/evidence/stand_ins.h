// Datasets of ours that are nearer to one of the paper's than ours of its name is. Pure functions;
// any thread.
#pragma once

#include <string_view>
#include <vector>

#include "benchmarks/evidence/scores.h"
#include "data/suites/suites.h"

namespace b4mrl {

struct StandIn {
  std::string_view dataset, by;
};
// D4RL's expert scores 88, that of our medium-expert 77, the late one 91 (data/DATASHEET.md).
inline constexpr StandIn kStandIns[] = {
    {"HalfCheetah/medium-expert", "HalfCheetah/medium-late-expert"}};

// Ours of the paper's cells on `dataset`, as they are on `by` with the same flaws; cells that have
// none there are left out. What uses no dataset stays as it is.
CellScores WithStandIn(const CellScores& ours, const std::vector<Benchmark>& benchmarks,
                       const StandIn& stand_in);

}  // namespace b4mrl
