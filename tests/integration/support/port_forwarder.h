// Carries tcp connections from a listening socket, of whatever network namespace, to a loopback
// port of this process's own: the one hole in a wall. Owns the socket; runs on a thread of its own.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

namespace b4mrl {

class PortForwarder {
 public:
  PortForwarder(int listening_fd, uint16_t port);
  ~PortForwarder();
  PortForwarder(const PortForwarder&) = delete;
  PortForwarder& operator=(const PortForwarder&) = delete;

  int connections() const { return connections_; }

 private:
  void Run(int listening_fd, uint16_t port);

  std::atomic<bool> stop_{false};
  std::atomic<int> connections_{0};
  std::thread thread_;
};

}  // namespace b4mrl
