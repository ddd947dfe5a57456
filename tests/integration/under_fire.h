// A walk (lane_walk.h) whose daemon's processes get signals meanwhile.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

#include "client/client.h"
#include "tests/integration/lane_walk.h"

namespace b4mrl {

// How long a test waits for what happens sooner or later.
inline constexpr int64_t kFirePatienceMs = 240'000;

// One line of the daemon's status; zeros if it cannot be had.
struct ProcessView {
  pid_t process_id = 0;
  uint64_t steps = 0;
  uint32_t restarts = 0;
};
ProcessView LookAt(Client& client, const std::string& role);

// Steps `walk` while another thread sends `signal` to `role` `times` times, each time after the
// successor has run, and the daemon has made `steps_between` steps more. Requires that every step
// succeeds.
void WalkUnderFire(LaneWalk& walk, const std::string& endpoint, const std::string& role, int signal,
                   int times, uint64_t steps_between);

}  // namespace b4mrl
