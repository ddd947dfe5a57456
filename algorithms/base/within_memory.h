// Memory that runs out is an error, not a crash: a user's options decide how much a run needs.
#pragma once

#include <new>
#include <string>
#include <string_view>

#include "proto/base/status.h"

namespace b4mrl {

// The status of `body`, or kFailedPrecondition, "not enough memory for <purpose>", if it ran out of
// memory on this thread. What `body` left half done must not be used then.
template <typename Body>
Status WithinMemory(std::string_view purpose, Body body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return Status(StatusCode::kFailedPrecondition, "not enough memory for " + std::string(purpose));
  }
}

}  // namespace b4mrl
