// The transitions of a training run, stepped again from its action log: `b4mrl dataset make` of a
// medium-replay level.
//
// A learner's lane starts from the environment seed RoleSeed(run seed, "train-lane", 0) and begins
// its next episode at once when one ends. Its experience is therefore a function of its actions,
// which the log holds. While the rows are stepped, the bytes that the run wrote into replay.bin
// (experience/replay_buffer.h) are formed again and hashed. Thread rule: one thread.
#pragma once

#include <cstdint>

#include "algorithms/base/progress.h"
#include "algorithms/episodes/recorder.h"
#include "client/client.h"
#include "data/d4rl/action_log.h"
#include "proto/base/status.h"

namespace b4mrl {

// Appends `rows` rows in their order, from the start of the newest episode after which the log has
// so many: like other recordings, they end within an episode. Returns that episode's number,
// counted from 0 at the beginning of the run. kInvalidArgument when the log has fewer rows than
// `rows`, or fits no such environment; kDataLoss when the experience is not the run's;
// kFailedPrecondition when the simulator gave up a step.
Result<uint64_t> ReplayActions(const ActionLog& log, uint64_t rows, Client& client,
                               Recorder& recorder, Progress& progress);

}  // namespace b4mrl
