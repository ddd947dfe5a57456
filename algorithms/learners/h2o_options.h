// The core's options of an H2O learner, made from its hyperparameters.
#pragma once

#include "algorithms/base/learner.h"
#include "algorithms/cores/h2o_core.h"

namespace b4mrl {

struct DatasetStats;

// `stats`: of the dataset as it is served.
H2oOptions H2oOptionsOf(const LearnerContext& context, const DatasetStats& stats);

}  // namespace b4mrl
