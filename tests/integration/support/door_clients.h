// Clients of a daemon's local door, and of the same daemon without one: a walk that is compared
// with an undisturbed one, a client in a process of its own, and what a worker holds of them.
#pragma once

#include <sys/types.h>

#include <functional>
#include <string>
#include <vector>

#include "client/client.h"
#include "client/private_daemon.h"
#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {

// A daemon with one worker of two threads.
PrivateDaemon StartDoorDaemon(std::vector<std::string> flags = {}, bool tcp = false);

// Opens the walk that RequireUndisturbedBytes compares with, and resets it.
LaneWalk OpenDoorWalk(Client& client);
// Compares with the same walk over ZeroMQ, which nothing disturbs.
void RequireUndisturbedBytes(const LaneWalk& walk);
// Steps `walk` while another thread does `something`, and receives what is in flight at the end.
// Returns the longest wait for a step, in seconds.
double WalkBeside(LaneWalk& walk, const std::function<void()>& something);
// Lets time pass, for tests of what happens at another moment.
void Pass(double microseconds);

// A client in a process of its own (tests/integration/door/walker.cc). Thread rule: one thread at a
// time.
class Walker {
 public:
  // `before`: words of a command that runs it.
  explicit Walker(const std::string& endpoint, std::vector<std::string> before = {});
  ~Walker() { End(); }
  Walker(const Walker&) = delete;
  Walker& operator=(const Walker&) = delete;

  void Signal(int signal) const;
  // Kills it and reads what it has said until then.
  void End();
  // Reads until it has said so many lines. False if it ends or takes too long.
  bool AwaitLines(size_t count);
  // All lines that it has said as a whole.
  std::vector<std::string> lines() const;

 private:
  bool ReadSome(const Deadline& deadline);

  ProgramWithOutput program_;
  bool is_running_ = false;
  std::string text_;
};

// A walker without a door, whom nothing disturbs, to compare with.
class UndisturbedWalker {
 public:
  UndisturbedWalker();
  // Whether a walker that said `line` has seen what it should.
  bool Says(const std::string& line);

 private:
  PrivateDaemon daemon_;
  Client client_;
  LaneWalk walk_;
};

// What a process holds: its descriptors and its mappings of doors.
struct Holdings {
  size_t descriptors = 0, doors = 0;
  bool operator==(const Holdings&) const = default;
};
Holdings HoldingsOf(pid_t process);

// Requires that the worker has not been replaced since `before` and that, sooner or later, it holds
// no more than then.
void RequireUnharmed(Client& client, const ProcessView& before, const Holdings& held);

}  // namespace b4mrl
