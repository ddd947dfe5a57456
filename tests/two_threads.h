// A process for which the system has few threads.
#pragma once

#include <pthread.h>
#include <sys/resource.h>

#include "tests/resource_limit.h"

namespace b4mrl {

// Leaves this process room for two more threads' stacks, but not for three. For the child of a
// fork, as the limits of a process cannot be raised again.
inline bool LeaveRoomForTwoThreads() {
  constexpr size_t kStack = 256 << 20;
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, kStack);
  if (pthread_setattr_default_np(&attributes) != 0) return false;
  const rlim_t room = AddressesInUse() + 5 * (kStack / 2);
  const rlimit limit{room, room};
  return setrlimit(RLIMIT_AS, &limit) == 0;
}

}  // namespace b4mrl
