// An environment worker's main loop, in the thread that owns the socket and the local doors, and
// simulates between two messages. The threads of the executor's pool only simulate.
#include <spdlog/spdlog.h>

#include <algorithm>

#include "proto/base/clock.h"
#include "proto/base/cores.h"
#include "proto/base/spin.h"
#include "server/door/doors.h"
#include "server/process/child.h"
#include "server/process/memory_shares.h"
#include "server/shared_memory/blame.h"
#include "server/worker/dispatcher.h"
#include "server/worker/executor.h"

namespace b4mrl {
namespace {

// Limits on the messages taken, and the seconds this takes, before completed work is answered: some
// messages are large.
constexpr int kReceiveBurst = 64;
constexpr double kReceiveBurstSeconds = 1e-4;
// Interval between two calls of AdoptNext, so that all records are looked at within a second.
constexpr int64_t kAdoptIntervalMs = 60;
// Interval at which a worker that has clients with local doors looks at its socket, which costs a
// system call, and at the doors' own sockets.
constexpr std::chrono::microseconds kSocketLookInterval(20);
constexpr std::chrono::microseconds kDoorLookInterval(1000);

// The last letter of a sender says which way its messages came. A peer of the socket chooses its
// own routing id. Without the letter, it could take the id of a door's client, and the replies to
// its requests would reach that client.
constexpr char kFromSocket = 's';
constexpr char kFromDoor = 'd';

// A worker's shares of the memory; the simulators of all workers together may come to take three
// eighths of the machine's.
WorkerShares MemoryOf(ChildContext& context) {
  WorkerShares memory = WorkerSharesOf(context.memory_bytes());
  const uint64_t of_the_machine = MemoryBytes() / 8 * 3 / context.shared().worker_count();
  memory.simulators = std::min(memory.simulators, of_the_machine);
  return memory;
}

class Worker {
 public:
  Worker(ChildContext& context, const WorkerShares& memory, RouterSocket socket, Doors doors,
         std::chrono::microseconds spin, std::vector<int> cores)
      : context_(context),
        socket_(std::move(socket)),
        doors_(std::move(doors)),
        spinner_(spin),
        executor_(context.options().threads, context.shared().marks(context.options().index), spin,
                  std::move(cores)),
        dispatcher_(context.shared(), context.options().index, executor_, memory,
                    [this](const RoutingId& receiver, Message reply) {
                      Send(receiver, std::move(reply));
                    }) {}

  Status Run();

 private:
  void Send(const RoutingId& receiver, Message reply);
  void ReceiveBurst();
  // The next message of a door or of the socket, which have their turns.
  std::optional<IncomingMessage> TryReceive();
  // Looks at the doors for a while instead of sleeping. Returns whether the loop should go round
  // once more.
  bool Spin();
  void Sleep();

  ChildContext& context_;
  RouterSocket socket_;
  Doors doors_;
  Spinner spinner_;
  bool doors_turn_ = false;
  bool socket_is_due_ = true;  // to be looked at
  Clock::time_point socket_look_{}, door_look_{};
  // Since when no door has had a message; nothing while a message is being answered.
  std::optional<Clock::time_point> doors_quiet_since_;
  Executor executor_;
  Dispatcher dispatcher_;
};

void Worker::Send(const RoutingId& receiver, Message reply) {
  const RoutingId id = receiver.substr(0, receiver.size() - 1);
  const Status status = receiver.back() == kFromDoor ? doors_.Send(id, std::move(reply))
                                                     : socket_.Send(id, std::move(reply));
  // A client that is gone asks again when it is back, and is answered from the slots.
  if (status.ok() || status.code() == StatusCode::kUnavailable) return;
  context_.record().errors.fetch_add(1, std::memory_order_relaxed);
}

std::optional<IncomingMessage> Worker::TryReceive() {
  doors_turn_ = !doors_turn_;
  for (const bool from_doors : {doors_turn_, !doors_turn_}) {
    std::optional<IncomingMessage> message;
    if (from_doors) {
      message = doors_.TryReceive();
      if (message && doors_quiet_since_) spinner_.Learn(Clock::now() - *doors_quiet_since_);
      if (message) doors_quiet_since_.reset();
    } else if (socket_is_due_) {
      message = socket_.TryReceive();
      socket_is_due_ = message.has_value();
    }
    if (!message) continue;
    message->sender.push_back(from_doors ? kFromDoor : kFromSocket);
    return message;
  }
  return std::nullopt;
}

void Worker::ReceiveBurst() {
  const Clock::time_point start = Clock::now();
  if (!doors_.any() || start - socket_look_ > kSocketLookInterval) socket_is_due_ = true;
  if (socket_is_due_) socket_look_ = start;
  if (start - door_look_ > kDoorLookInterval) {
    doors_.Attend();
    door_look_ = start;
  }
  std::optional<IncomingMessage> next = TryReceive();
  for (int i = 0; next; ++i) {
    IncomingMessage current = std::move(*next);
    const bool goes_on = i + 1 < kReceiveBurst && SecondsSince(start) < kReceiveBurstSeconds;
    next = goes_on ? TryReceive() : std::nullopt;
    dispatcher_.Handle(std::move(current), next.has_value());
  }
}

bool Worker::Spin() {
  if (!doors_.any()) return false;
  if (!doors_quiet_since_) doors_quiet_since_ = Clock::now();
  const auto is_over = [this] { return doors_.HasWork() || executor_.has_completed(); };
  return spinner_.Spin(*doors_quiet_since_, is_over, kSocketLookInterval) ||
         spinner_.MaySpin(*doors_quiet_since_, Clock::now());
}

void Worker::Sleep() {
  if (executor_.BeginWait() && doors_.BeginSleep()) {
    void* const socket = socket_.handle();
    const int readable[] = {executor_.completion_fd(), doors_.epoll_fd()};
    WaitAnyReadable({&socket, 1}, std::min(kBeatIntervalMs, dispatcher_.MsToNextTurn()),
                    std::span(readable).first(doors_.epoll_fd() < 0 ? 1 : 2));
  }
  doors_.EndSleep();
  executor_.EndWait();
  socket_is_due_ = true;
  // Bells are taken off at once; otherwise the next sleep would end at once.
  if (doors_.any()) door_look_ = {};
}

Status Worker::Run() {
  dispatcher_.AdoptSessions();
  // The first beat reports that the worker is ready, so a crash at the first message counts as a
  // crash at a message, not at the start.
  context_.Beat();
  int64_t next_reap_ms = 0, next_adopt_ms = 0;
  while (true) {
    ReceiveBurst();
    dispatcher_.EndExpired();
    dispatcher_.FinishCompleted();
    dispatcher_.BuildNext(Clock::now());
    context_.Beat();
    if (context_.draining()) {
      dispatcher_.StopAccepting();
      if (dispatcher_.idle()) break;
    }
    if (const int64_t now = MonotonicMs(); now >= next_reap_ms) {
      dispatcher_.ReapIdleSessions(now);
      next_reap_ms = now + kReapIntervalMs;
    }
    if (const int64_t now = MonotonicMs(); now >= next_adopt_ms) {
      dispatcher_.AdoptNext();
      next_adopt_ms = now + kAdoptIntervalMs;
    }
    if (!executor_.RunBite() && !Spin()) Sleep();
  }
  doors_.Drain(kFlushMs);
  socket_.LingerOnClose(kFlushMs);
  return Status();
}

// The cores of this worker's threads, by thread; the threads of all workers take the cores in
// turns.
std::vector<int> CoresOf(const ChildOptions& options) {
  std::vector<int> cores;
  if (!options.pin) return cores;
  const std::vector<int> available = AvailableCores();
  for (uint32_t i = 0; i < options.threads; ++i) {
    cores.push_back(available[(options.index * options.threads + i) % available.size()]);
  }
  return cores;
}

}  // namespace

Status RunWorker(ChildContext& context) {
  InstallCrashRecorder(context.record());
  if (context.options().index >= context.shared().worker_count()) {
    return InvalidNumber("--index", context.options().index, "below the number of workers");
  }
  const std::vector<int> cores = CoresOf(context.options());
  const uint32_t spin_us = context.options().spin_us.value_or(0);
  const std::chrono::microseconds spin = SpinBudget(spin_us);
  // Pinned before ZeroMQ's thread for input and output starts, which then shares the core: waking a
  // thread of another core costs several microseconds more.
  if (!cores.empty()) PinThisThread({cores[0]});
  Context sockets;
  const WorkerShares memory = MemoryOf(context);
  B4MRL_ASSIGN_OR_RETURN(RouterSocket socket,
                         RouterSocket::Bind(sockets, context.options().endpoints, memory.unread));
  Doors doors(context.options().door_listener, spin_us, socket.unread().Beside(),
              memory.unfinished);
  Worker worker(context, memory, std::move(socket), std::move(doors), spin, cores);
  return worker.Run();
}

}  // namespace b4mrl
