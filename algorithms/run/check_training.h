// What can be told of a run before anything is opened for it, so that whoever plans many runs can
// check each without starting it. Thread rule: pure functions.
#pragma once

#include <span>
#include <string>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/run/run_record.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// The algorithm's defaults in `environment` with `texts`, names and values as users write them, in
// their order. kUnknownName with the nearest known name; kInvalidArgument with the allowed range.
Result<Hyperparameters> ReadHyperparameters(
    const Algorithm& algorithm, const std::string& environment,
    std::span<const std::pair<std::string, std::string>> texts);

// kInvalidArgument, with the option's name, where the algorithm takes no simulator, dataset or
// history and the options name one, or it needs a dataset and they do not. Asks no daemon.
Status CheckNeeds(const TrainOptions& options, const Algorithm& algorithm);

// kInvalidArgument, with the option's name, for more observations at once than an agent file holds,
// for a score to stop at where the environment has none, and for hyperparameters that do not go
// together or not with `environment`. Train checks it too.
Status CheckTraining(const TrainOptions& options, const EnvironmentSpec& environment);

}  // namespace b4mrl
