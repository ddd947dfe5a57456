// Whether anybody still listens at the place to which a connection was made.
//
// The daemon's supervisor holds all listening sockets and replaces the processes behind them. So a
// Unix socket that refuses a connection, or that is not there any more, means that the daemon has
// ended. A tcp port alone tells less, as a tunnel that drops refuses connections until it is up
// again; where the connection had a local door, there is no tunnel.
//
// Thread rule: one thread.
#pragma once

#include <string>

#include "proto/base/clock.h"

namespace b4mrl {

class Listening {
 public:
  // `door`: the local door by which the connection to `address` was made, or "".
  Listening(std::string address, std::string door);

  // Connects and hangs up, at most once a second. Takes 0.2 s at most.
  void Look(Clock::time_point now);
  // The time of the look that found nobody; the end of time while somebody listens, or while that
  // cannot be known.
  Clock::time_point gone_since() const { return gone_since_; }
  const std::string& address() const { return address_; }

 private:
  bool IsGone() const;

  std::string address_, door_;
  Clock::time_point next_look_{};
  Clock::time_point gone_since_ = Clock::time_point::max();
};

}  // namespace b4mrl
