// Passing descriptors over a connected Unix socket (SCM_RIGHTS, unix(7)).
//
// Thread rule: any thread.
#pragma once

#include <cstddef>
#include <span>

#include "proto/base/unique_fd.h"

namespace b4mrl {

// The most descriptors of one message.
inline constexpr size_t kMaxDescriptors = 8;

// Sends `size` bytes as one message with 1 to kMaxDescriptors descriptors, which stay open here.
// Never waits. Returns whether all of it was taken; errno says why not.
bool SendWithDescriptors(int socket, const void* data, size_t size, std::span<const int> fds);

// Receives `size` bytes and the one descriptor that comes with them. `flags`: 0, or MSG_DONTWAIT as
// of recvmsg. Invalid unless exactly that came; of anything else no descriptor stays open.
UniqueFd ReceiveWithDescriptor(int socket, void* data, size_t size, int flags);

}  // namespace b4mrl
