#include "tests/integration/support/port_forwarder.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <vector>

#include "tests/loopback.h"

namespace b4mrl {
namespace {

constexpr int kTickMs = 20;

// Moves what is there; false when an end has hung up.
bool Move(int from, int to) {
  std::array<char, 64 * 1024> buffer;
  const ssize_t size = read(from, buffer.data(), buffer.size());
  for (ssize_t done = 0; done < size;) {
    const ssize_t sent =
        send(to, buffer.data() + done, static_cast<size_t>(size - done), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    done += sent;
  }
  return size > 0;
}

struct Pair {
  int outside;
  int inside;
};

}  // namespace

PortForwarder::PortForwarder(int listening_fd, uint16_t port)
    : thread_([this, listening_fd, port] { Run(listening_fd, port); }) {}

PortForwarder::~PortForwarder() {
  stop_ = true;
  thread_.join();
}

void PortForwarder::Run(int listening_fd, uint16_t port) {
  std::vector<Pair> pairs;
  while (!stop_) {
    std::vector<pollfd> items = {{listening_fd, POLLIN, 0}};
    for (const Pair& pair : pairs) {
      items.push_back({pair.outside, POLLIN, 0});
      items.push_back({pair.inside, POLLIN, 0});
    }
    if (poll(items.data(), items.size(), kTickMs) <= 0) continue;
    std::vector<Pair> open;
    for (size_t i = 0; i < pairs.size(); ++i) {
      const Pair pair = pairs[i];
      const bool alive = (items[2 * i + 1].revents == 0 || Move(pair.outside, pair.inside)) &&
                         (items[2 * i + 2].revents == 0 || Move(pair.inside, pair.outside));
      if (alive) {
        open.push_back(pair);
      } else {
        close(pair.outside);
        close(pair.inside);
      }
    }
    pairs = std::move(open);
    if (items[0].revents == 0) continue;
    const Pair pair{accept(listening_fd, nullptr, nullptr), ConnectToLoopback(port).Release()};
    if (pair.outside >= 0 && pair.inside >= 0) {
      pairs.push_back(pair);
      ++connections_;
    }
  }
  for (const Pair& pair : pairs) {
    close(pair.outside);
    close(pair.inside);
  }
  close(listening_fd);
}

}  // namespace b4mrl
