// A walk (lane_walk.h) whose daemon's processes get signals meanwhile.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <string>

#include "client/client.h"
#include "tests/integration/support/lane_walk.h"

namespace b4mrl {

// How long a test waits for what happens sooner or later.
inline constexpr int64_t kFirePatienceMs = 240'000;

// One line of the daemon's status; zeros if it cannot be had.
struct ProcessView {
  pid_t process_id = 0;
  uint64_t steps = 0;
  uint32_t restarts = 0;
  uint64_t requests = 0;
};
ProcessView LookAt(Client& client, const std::string& role);
// LookAt as soon as that process has got more requests than in `before`.
ProcessView AwaitRequest(Client& client, const std::string& role, const ProcessView& before);

// Who is hit, by what, how often. Each time the successor has to run, and to have made so many
// steps more.
struct Fire {
  std::string role;
  int signal;
  int times;
  uint64_t steps_between = 0;
};

// Calls `advance` again and again while another thread fires. Requires that it always succeeds.
void AdvanceUnderFire(const std::string& endpoint, const Fire& fire,
                      const std::function<Status()>& advance);
// Steps `walk` meanwhile, and receives what is in flight at the end.
void WalkUnderFire(LaneWalk& walk, const std::string& endpoint, const Fire& fire);

}  // namespace b4mrl
