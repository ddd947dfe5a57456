// Memory or threads that run out are an error, not a crash: a user's options decide how much a run
// needs.
#pragma once

#include <cstdio>
#include <new>
#include <string>
#include <string_view>
#include <system_error>

#include "proto/base/status.h"

namespace b4mrl {

// The status of `body`, or kFailedPrecondition, "not enough memory for <purpose>", if it ran out of
// memory on this thread, or could start no more threads. What `body` left half done must not be
// used then.
template <typename Body>
Status WithinMemory(std::string_view purpose, Body body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return Status(StatusCode::kFailedPrecondition, "not enough memory for " + std::string(purpose));
  } catch (const std::system_error& error) {
    // What fmt::print throws where a stream takes no more is for RunProgram to answer.
    const bool is_output = std::ferror(stdout) != 0 || std::ferror(stderr) != 0;
    if (is_output || error.code() != std::errc::resource_unavailable_try_again) throw;
    return Status(StatusCode::kFailedPrecondition,
                  "the system starts no more threads (ulimit -u, ulimit -v) for " +
                      std::string(purpose) + "; allowed: fewer --threads");
  }
}

}  // namespace b4mrl
