// Opening the simulator of a run.
#pragma once

#include <cstdint>

#include "algorithms/base/learner.h"
#include "client/remote_environment.h"
#include "proto/base/status.h"

namespace b4mrl {

// A session of the context's simulator with so many lanes, which begin their next episode within
// the step that ended one; 0: for queries alone. kInvalidArgument when its sizes are not the
// environment's, from which everything else takes its own.
Result<RemoteEnvironment> OpenTrainingSimulator(const LearnerContext& context, uint32_t lanes);

}  // namespace b4mrl
