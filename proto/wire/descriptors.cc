#include "proto/wire/descriptors.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace b4mrl {

bool SendWithDescriptors(int socket, const void* data, size_t size, std::span<const int> fds) {
  if (fds.empty() || fds.size() > kMaxDescriptors) {
    errno = EINVAL;
    return false;
  }
  iovec bytes{const_cast<void*>(data), size};
  alignas(cmsghdr) char control[CMSG_SPACE(kMaxDescriptors * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = CMSG_SPACE(fds.size_bytes());
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(fds.size_bytes());
  std::memcpy(CMSG_DATA(header), fds.data(), fds.size_bytes());
  return sendmsg(socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL) == static_cast<ssize_t>(size);
}

UniqueFd ReceiveWithDescriptor(int socket, void* data, size_t size, int flags) {
  iovec bytes{data, size};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &bytes;
  message.msg_iovlen = 1;
  message.msg_control = control;
  // Without the padding, which has room for a second descriptor.
  message.msg_controllen = CMSG_LEN(sizeof(int));
  const ssize_t received = recvmsg(socket, &message, flags | MSG_CMSG_CLOEXEC);
  UniqueFd fd;
  const cmsghdr* const header = received > 0 ? CMSG_FIRSTHDR(&message) : nullptr;
  if (header != nullptr && header->cmsg_type == SCM_RIGHTS &&
      header->cmsg_len == CMSG_LEN(sizeof(int))) {
    int value = -1;
    std::memcpy(&value, CMSG_DATA(header), sizeof(value));
    fd = UniqueFd(value);
  }
  const bool has_more = (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) != 0;
  if (received != static_cast<ssize_t>(size) || has_more) return UniqueFd();
  return fd;
}

}  // namespace b4mrl
