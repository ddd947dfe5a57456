// b4mrl-serve with a fault in it, for the tests of recovery. B4MRL_FAULT says which:
//   crash:LANE:NUMBER                 operation NUMBER of lane LANE ends the process, every time
//   exit:LANE:NUMBER                  the same through exit(), as a library may do it
//   hang:LANE:NUMBER                  it never returns, every time
//   spin:LANE:NUMBER                  the same in an endless loop, every time
//   hang-once:LANE:NUMBER:FILE        it never returns; FILE remembers that this has happened
//   tear-once:LANE:NUMBER:FILE        killed with the slot's idle buffer half written
//   kill-after-once:LANE:NUMBER:FILE  killed after the commit and before the reply
//   crash-query:ROW                   row ROW of any query ends the process, every time
//   crash-snapshot:LANE               any snapshot of lane LANE ends it, every time
//   crash-restore:LANE                setting lane LANE by the parts of a state ends it, every time
//   crash-attach:LANES                building a session of so many lanes ends it, every time
//   slow-attach:LANES:MS              building a session of so many lanes takes MS ms longer
//
// LANE counts over all sessions.
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <string>

#include "server/serve_main.h"
#include "server/worker/fault_point.h"

namespace b4mrl {
namespace {

struct Fault {
  std::string kind;
  uint32_t lane = 0;
  uint64_t number = 0;
  std::string file;
};
Fault planned;

Fault ParseFault(const char* text) {
  Fault fault;
  std::istringstream stream(text);
  std::string lane, number;
  std::getline(stream, fault.kind, ':');
  std::getline(stream, lane, ':');
  std::getline(stream, number, ':');
  std::getline(stream, fault.file);
  fault.lane = static_cast<uint32_t>(std::strtoul(lane.c_str(), nullptr, 10));
  fault.number = std::strtoull(number.c_str(), nullptr, 10);
  return fault;
}

// True for the first process that asks.
bool FirstTime() {
  const int fd = open(planned.file.c_str(), O_CREAT | O_EXCL | O_WRONLY, 0600);
  if (fd >= 0) close(fd);
  return fd >= 0;
}

void Hang() {
  while (true) pause();
}

void Spin() {
  volatile uint64_t turns = 0;
  while (true) {
    turns = turns + 1;
  }
}

void BreakOperation(FaultPoint point, std::span<std::byte> idle_buffer) {
  const std::string& kind = planned.kind;
  if (point == FaultPoint::kBeforeOperation) {
    if (kind == "crash") std::abort();
    if (kind == "exit") _exit(1);
    if (kind == "spin") Spin();
    if (kind == "hang" || (kind == "hang-once" && FirstTime())) Hang();
  }
  if (point == FaultPoint::kSlotHalfWritten && kind == "tear-once" && FirstTime()) {
    std::memset(idle_buffer.data() + idle_buffer.size() / 2, 0xa5, idle_buffer.size() / 2);
    raise(SIGKILL);
  }
  if (point == FaultPoint::kAfterCommit && kind == "kill-after-once" && FirstTime()) {
    raise(SIGKILL);
  }
}

// Whether the process ends at this point of the planned lane, whatever the number.
bool CrashesAt(FaultPoint point) {
  switch (point) {
    case FaultPoint::kBeforeAttach:
      return planned.kind == "crash-attach";
    case FaultPoint::kBeforeQueryRow:
      return planned.kind == "crash-query";
    case FaultPoint::kBeforeSnapshot:
      return planned.kind == "crash-snapshot";
    case FaultPoint::kBeforeRestore:
      return planned.kind == "crash-restore";
    default:
      return false;
  }
}

void BreakAtPoint(FaultPoint point, uint32_t lane, uint64_t number,
                  std::span<std::byte> idle_buffer) {
  if (lane != planned.lane) return;
  if (CrashesAt(point)) std::abort();
  if (point == FaultPoint::kBeforeAttach && planned.kind == "slow-attach") {
    poll(nullptr, 0, static_cast<int>(planned.number));
  }
  if (number == planned.number) BreakOperation(point, idle_buffer);
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) {
  if (const char* text = std::getenv("B4MRL_FAULT"); text != nullptr) {
    b4mrl::planned = b4mrl::ParseFault(text);
    b4mrl::fault_hook = b4mrl::BreakAtPoint;
  }
  return b4mrl::ServeMain(argc, argv);
}
