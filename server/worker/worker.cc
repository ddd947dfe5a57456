// An environment worker's main loop, in the thread that owns the socket and simulates between two
// messages. The threads of the executor's pool only simulate.
#include <spdlog/spdlog.h>

#include <algorithm>

#include "proto/base/clock.h"
#include "proto/base/cores.h"
#include "proto/base/limits.h"
#include "server/process/child.h"
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

class Worker {
 public:
  Worker(ChildContext& context, RouterSocket socket, std::vector<int> cores)
      : context_(context),
        socket_(std::move(socket)),
        executor_(context.options().threads, context.shared().marks(context.options().index),
                  std::move(cores)),
        dispatcher_(context.shared(), context.options().index, executor_,
                    [this](const RoutingId& receiver, Message reply) {
                      Send(receiver, std::move(reply));
                    }) {}

  Status Run();

 private:
  void Send(const RoutingId& receiver, Message reply);
  void ReceiveBurst();

  ChildContext& context_;
  RouterSocket socket_;
  Executor executor_;
  Dispatcher dispatcher_;
};

void Worker::Send(const RoutingId& receiver, Message reply) {
  const Status status = socket_.Send(receiver, std::move(reply));
  // A client that is gone asks again when it is back, and is answered from the slots.
  if (status.ok() || status.code() == StatusCode::kUnavailable) return;
  context_.record().errors.fetch_add(1, std::memory_order_relaxed);
}

void Worker::ReceiveBurst() {
  std::optional<IncomingMessage> next = socket_.TryReceive();
  if (!next) return;
  const Clock::time_point start = Clock::now();
  for (int i = 0; next; ++i) {
    IncomingMessage current = std::move(*next);
    const bool goes_on = i + 1 < kReceiveBurst && SecondsSince(start) < kReceiveBurstSeconds;
    next = goes_on ? socket_.TryReceive() : std::nullopt;
    dispatcher_.Handle(std::move(current), next.has_value());
    context_.Beat();  // a burst may build many sessions
  }
}

Status Worker::Run() {
  dispatcher_.AdoptSessions();
  // The first beat reports that the worker is ready, so a crash at the first message counts as a
  // crash at a message, not at the start.
  context_.Beat();
  const int completion_fd = executor_.completion_fd();
  int64_t next_reap_ms = 0, next_adopt_ms = 0;
  while (true) {
    ReceiveBurst();
    dispatcher_.EndExpired();
    dispatcher_.FinishCompleted();
    context_.Beat();
    if (context_.draining()) {
      dispatcher_.StopAccepting();
      if (dispatcher_.idle()) break;
    }
    if (const int64_t now = MonotonicMs(); now >= next_reap_ms) {
      dispatcher_.ReapIdleSessions();
      next_reap_ms = now + kReapIntervalMs;
    }
    if (const int64_t now = MonotonicMs(); now >= next_adopt_ms) {
      dispatcher_.AdoptNext();
      next_adopt_ms = now + kAdoptIntervalMs;
    }
    if (executor_.RunBite()) continue;
    if (executor_.BeginWait()) {
      void* const socket = socket_.handle();
      WaitAnyReadable({&socket, 1}, std::min(kBeatIntervalMs, dispatcher_.MsToNextDeadline()),
                      {&completion_fd, 1});
    }
    executor_.EndWait();
  }
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
  InstallCrashRecorder();
  if (context.options().index >= context.shared().worker_count()) {
    return InvalidNumber("--index", context.options().index, "below the number of workers");
  }
  const std::vector<int> cores = CoresOf(context.options());
  // Pinned before ZeroMQ's thread for input and output starts, which then shares the core: waking a
  // thread of another core costs several microseconds more.
  if (!cores.empty()) PinThisThread({cores[0]});
  Context sockets;
  B4MRL_ASSIGN_OR_RETURN(RouterSocket socket,
                         RouterSocket::Bind(sockets, context.options().endpoints));
  Worker worker(context, std::move(socket), cores);
  return worker.Run();
}

}  // namespace b4mrl
