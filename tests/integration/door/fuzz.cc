// Two processes at a local door: numbered messages that are echoed, and a hunt for bells that are
// lost.
//
//   door_fuzz MESSAGES LARGE ROUNDS SCRIBBLES [threads]
//
// MESSAGES of 1 B to 64 KiB and LARGE ones of 64 KiB to 64 MiB, log-uniform, are sent to a worker,
// who sends them back; every byte is checked. Then ROUNDS of a few messages each are exchanged,
// while both ends pause at random at every point of the sleeping protocol (pauses.h). At last
// messages are exchanged beside a client that breaks every rule on SCRIBBLES connections
// (scribbler.h). With `threads` both ends are threads of one process, for ThreadSanitizer. The exit
// code is 1 if a message was wrong or a bell was lost.
//
//   door_fuzz echo NAME [pauses]
//
// Is the worker of one client of the door NAME, written in whatever language: prints "ready", sends
// all messages back, and ends when the client has gone.
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <new>

#include <fmt/format.h>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "proto/wire/client_door.h"
#include "server/door/doors.h"
#include "tests/integration/door/pauses.h"
#include "tests/integration/door/scribbler.h"
#include "tests/proto/wire/numbered_message.h"
#include "tests/proto/wire/raw_door.h"

namespace b4mrl {
namespace {

constexpr uint64_t kSeed = 20;
constexpr uint64_t kPauseOneIn = 3;
constexpr uint32_t kSpinUs = 100;        // without pauses
constexpr int64_t kPatienceMs = 60'000;  // for one message, on a busy machine
constexpr int kWorkerSleepMs = 100;      // as the worker's loop

struct Sizes {
  size_t envelope, payload;
};

// A numbered exchange: how large its messages are, and how many may be on their way.
struct Exchange {
  uint64_t messages = 0;
  std::function<Sizes(uint64_t number)> sizes;
  std::function<uint64_t(uint64_t number)> window;
};

size_t LogUniform(double lowest, double highest, double uniform) {
  return static_cast<size_t>(lowest * std::pow(highest / lowest, uniform));
}

// The bytes of message `number` are split between envelope and payload in many ways.
Sizes Split(size_t bytes, uint64_t number) {
  size_t envelope = MixSeeds(number, 2) % 4 == 0 ? bytes : MixSeeds(number, 3) % 200;
  envelope = std::min({envelope, bytes, limits::kMaxEnvelopeBytes});
  return {envelope, bytes - envelope};
}

Exchange Messages(uint64_t count, double lowest, double highest, uint64_t most_underway) {
  return {count,
          [=](uint64_t number) {
            return Split(LogUniform(lowest, highest, Rng(kSeed, "size", number).Uniform()), number);
          },
          [=](uint64_t number) { return 1 + MixSeeds(number / 1000, 4) % most_underway; }};
}

// Rounds of one to three messages. One in 64 is longer than a ring, so both ends wait for space.
Exchange Rounds(uint64_t count) {
  return {count,
          [](uint64_t number) {
            const bool is_long = MixSeeds(number, 5) % 64 == 0;
            const uint64_t most = is_long ? 4 * limits::kRingBytes : 200;
            return Split(1 + MixSeeds(number, 6) % most, number);
          },
          [](uint64_t number) { return 1 + MixSeeds(number, 7) % 3; }};
}

// The worker's loop, without its work: what comes is sent back. Ends when the client has gone.
void Echo(int listener, uint32_t spin_us) {
  BeginEnd(kSeed, true);
  Doors doors(listener, spin_us);
  bool was_connected = false;
  while (!was_connected || doors.any()) {
    bool has_worked = false;
    while (std::optional<IncomingMessage> incoming = doors.TryReceive()) {
      has_worked = true;
      // A client that lacks a reply will say so.
      (void)doors.Send(incoming->sender, std::move(incoming->message));
    }
    if (has_worked) continue;
    Pause();
    if (doors.BeginSleep()) {
      epoll_event event;
      PausedEpollWait(doors.epoll_fd(), &event, 1, kWorkerSleepMs);
    }
    doors.EndSleep();
    doors.Attend();
    was_connected |= doors.any();
  }
}

// Sends the messages of an exchange and checks what comes back. False if something is wrong.
bool Run(const Exchange& exchange, ClientDoor& door) {
  uint64_t sent = 0, received = 0;
  while (received < exchange.messages) {
    const uint64_t window = exchange.window(received);
    while (sent < exchange.messages && sent - received < window) {
      const Sizes sizes = exchange.sizes(sent);
      const Status status = door.Send(NumberedMessage(sizes.envelope, sizes.payload, sent));
      if (!status.ok()) return fmt::print(stderr, "{}\n", status.ToString()), false;
      ++sent;
    }
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    std::optional<Message> message;
    while (!message && !deadline.expired()) message = door.Receive(deadline);
    const Sizes sizes = exchange.sizes(received);
    if (!message || door.connections() != 1 ||
        !IsNumberedMessage(*message, sizes.envelope, sizes.payload, received)) {
      fmt::print(stderr, "message {} of {} + {} bytes {}, after {} connections\n", received,
                 sizes.envelope, sizes.payload, message ? "is another one" : "did not come",
                 door.connections());
      return false;
    }
    ++received;
  }
  return true;
}

// Exchanges messages for as long as another client scribbles.
bool RunBesideScribbler(const std::string& name, ClientDoor& door, uint64_t connections) {
  std::atomic<uint64_t> scribbled{0};
  std::atomic<bool> done{false};
  std::thread scribbler([&] {
    for (uint64_t seed = 0; seed < connections; ++seed) scribbled += Scribble(name, seed) ? 1 : 0;
    done = true;
  });
  bool is_right = true;
  uint64_t exchanges = 0;
  for (; is_right && !done; ++exchanges) is_right = Run(Messages(100, 1, 65'536, 16), door);
  scribbler.join();
  fmt::print("beside a client that scribbled on {} of {} connections: {} messages {}\n",
             scribbled.load(), connections, 100 * exchanges,
             is_right ? "came back as they were" : "FAILED");
  return is_right && scribbled == connections;
}

// Runs `body` with a client of a door, and the worker beside it.
bool BesideWorker(bool by_threads, uint32_t spin_us,
                  const std::function<bool(const std::string& name, ClientDoor& door)>& body) {
  const std::string name = fmt::format("b4mrl-door-fuzz-{}", getpid());
  const UniqueFd listener = ListenAtDoor(name);
  if (!listener.valid()) return false;
  std::thread thread;
  pid_t process = 0;
  if (by_threads) {
    thread = std::thread(Echo, listener.get(), spin_us);
  } else if (process = fork(); process == 0) {
    Echo(listener.get(), spin_us);
    _exit(0);
  }
  bool is_right = false;
  {
    BeginEnd(kSeed, false);
    Result<ClientDoor> door = ClientDoor::Connect(name, Deadline::AfterMs(kPatienceMs));
    is_right = door.ok() && body(name, *door);
  }
  int code = 0;
  if (by_threads) {
    thread.join();
  } else {
    waitpid(process, &code, 0);
  }
  return is_right && code == 0;
}

SleepCounts& SharedCounts() {
  void* const shared =
      mmap(nullptr, sizeof(SleepCounts), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  return *new (shared) SleepCounts;
}

int EchoAs(const std::string& name, bool with_pauses) {
  const UniqueFd listener = ListenAtDoor(name);
  if (!listener.valid()) return 1;
  SleepCounts& counts = SharedCounts();
  BeginPauses(&counts, with_pauses ? kPauseOneIn : 0);
  fmt::print("ready\n");
  std::fflush(stdout);
  Echo(listener.get(), with_pauses ? 0 : kSpinUs);
  fmt::print("{} sleeps, {} late bells, {} lost bells\n", counts.sleeps.load(),
             counts.late_bells.load(), counts.lost_bells.load());
  return counts.lost_bells == 0 ? 0 : 1;
}

}  // namespace

int Main(int argc, char** argv) {
  if (argc > 2 && std::string_view(argv[1]) == "echo") return EchoAs(argv[2], argc > 3);
  if (argc < 5) {
    return fmt::print(stderr, "door_fuzz MESSAGES LARGE ROUNDS SCRIBBLES [threads]\n"), 2;
  }
  const uint64_t messages = std::strtoull(argv[1], nullptr, 10);
  const uint64_t large = std::strtoull(argv[2], nullptr, 10);
  const uint64_t rounds = std::strtoull(argv[3], nullptr, 10);
  const uint64_t scribbles = std::strtoull(argv[4], nullptr, 10);
  const bool by_threads = argc > 5;
  SleepCounts& counts = SharedCounts();
  const auto run = [&](const char* name, const Exchange& exchange, uint64_t one_in,
                       uint32_t spin_us) {
    BeginPauses(&counts, one_in);
    const Clock::time_point start = Clock::now();
    const bool is_right =
        BesideWorker(by_threads, spin_us,
                     [&](const std::string&, ClientDoor& door) { return Run(exchange, door); });
    fmt::print("{}: {} messages {}, {:.1f} s\n", name, exchange.messages,
               is_right ? "came back as they were" : "FAILED", SecondsSince(start));
    std::fflush(stdout);
    return is_right;
  };
  bool is_right = run("1 B to 64 KiB", Messages(messages, 1, 65'536, 64), 0, kSpinUs);
  is_right &= run("64 KiB to 64 MiB", Messages(large, 65'536, 64 << 20, 3), 0, kSpinUs);
  counts.sleeps = 0;
  is_right &= run("with pauses", Rounds(rounds), kPauseOneIn, 0);
  fmt::print("{} sleeps, {} pauses, {} late bells, {} lost bells\n", counts.sleeps.load(),
             counts.pauses.load(), counts.late_bells.load(), counts.lost_bells.load());
  BeginPauses(&counts, 0);
  is_right &= BesideWorker(by_threads, 0, [scribbles](const std::string& name, ClientDoor& door) {
    return RunBesideScribbler(name, door, scribbles);
  });
  return is_right && counts.lost_bells == 0 ? 0 : 1;
}

}  // namespace b4mrl

int main(int argc, char** argv) { return b4mrl::Main(argc, argv); }
