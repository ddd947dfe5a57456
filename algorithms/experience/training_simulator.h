// Opens the simulator that a run's learner uses.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "algorithms/base/learner.h"
#include "client/remote_environment.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"

namespace b4mrl {

// Opens a session of the context's simulator with `lanes` lanes, which begin their next episode
// within the step that ends one; with 0 lanes the session serves queries alone. kInvalidArgument
// when the simulator's observation or action has another size than the environment's.
Result<RemoteEnvironment> OpenTrainingSimulator(const LearnerContext& context, uint32_t lanes);

// Calls `step` again and again while the daemon refuses it for a reason that passes: the lanes are
// being copied still (kBusy), or requests fill the worker's room (kLimitExceeded). Such a step has
// not been taken. Ends with the last refusal after kLearnerDeadlineMs; kUnavailable once `stop` is
// set.
Result<StepOutcome> UntilTaken(const std::function<Result<StepOutcome>()>& step,
                               const std::atomic<bool>& stop);

// Whether a session that got its last request at `asked` should get another one or be opened again,
// since the daemon ends sessions that get none for its lease: after a third of the lease.
bool IsDueAgain(const Client& client, Clock::time_point asked);

}  // namespace b4mrl
