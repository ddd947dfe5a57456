// Waits for files that other processes make or rename into place. For tests; one thread.
#pragma once

#include <poll.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <string>

namespace b4mrl {

class FolderWatch {
 public:
  explicit FolderWatch(const std::string& folder) : fd_(inotify_init1(IN_CLOEXEC)) {
    REQUIRE(inotify_add_watch(fd_, folder.c_str(), IN_CREATE | IN_MOVED_TO) >= 0);
  }
  ~FolderWatch() { close(fd_); }
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

  // Returns once a file of this name has appeared since; false when a minute passes without any.
  bool WaitFor(const std::string& name) {
    alignas(inotify_event) std::array<char, 4096> events{};
    for (pollfd wait = {fd_, POLLIN, 0}; poll(&wait, 1, 60'000) == 1;) {
      const ssize_t got = read(fd_, events.data(), events.size());
      for (ssize_t at = 0; at < got;) {
        const auto* event = reinterpret_cast<const inotify_event*>(events.data() + at);
        if (event->len > 0 && name == event->name) return true;
        at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
      }
    }
    return false;
  }

 private:
  int fd_;
};

}  // namespace b4mrl
