// Whether the benchmarks of suites can be had: what data/suites, which knows no perturbation,
// cannot say. Pure function; any thread.
#pragma once

#include <vector>

#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

// The error of the first benchmark whose environment is unknown, or whose simulator, world or
// corruption cannot be: as of FindEnvironment, ParseNamedArguments and MakePerturbations, with the
// benchmark's name and the key. Whether models of users (model=FILE) are there is not looked at.
Status CheckSuites(const std::vector<Benchmark>& benchmarks);

}  // namespace b4mrl
