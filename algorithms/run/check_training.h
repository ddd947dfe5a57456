// Checks of a run's options that open nothing, so that a script that plans many runs can check them
// all before it starts one. Thread rule: pure functions.
#pragma once

#include <span>
#include <string>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/run/run_record.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// The algorithm's defaults in `environment`, changed by `texts`: (name, value) as users write them,
// applied in order. kUnknownName suggests the nearest name; kInvalidArgument states the range.
Result<Hyperparameters> ReadHyperparameters(
    const Algorithm& algorithm, const std::string& environment,
    std::span<const std::pair<std::string, std::string>> texts);

// kInvalidArgument, naming the option, if the options give a simulator, dataset or history that the
// algorithm does not take, lack an environment or a needed dataset, or give a corruption's seed
// without a corruption. Asks no daemon.
Status CheckNeeds(const TrainOptions& options, const Algorithm& algorithm);

// kInvalidArgument, naming the option, for a --history longer than an agent file holds, for a
// --stop-at-score in an environment without normalised scores, for a --precision that would change
// nothing, and for hyperparameters that contradict each other or `environment`; kFailedPrecondition
// for a --precision that this processor lacks; kUnsupported for actions that no learner can scale.
// Train runs this check, too.
Status CheckTraining(const TrainOptions& options, const EnvironmentSpec& environment);

}  // namespace b4mrl
