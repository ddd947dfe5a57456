#include "server/supervisor/supervisor.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/exit_codes.h"
#include "server/supervisor/child_process.h"
#include "server/supervisor/listeners.h"
#include "server/supervisor/service_manager.h"

namespace b4mrl {
namespace {

constexpr int64_t kTickMs = 50;
// A longer gap between two ticks means that the supervisor itself (or the machine) stood still.
constexpr int64_t kPausedMs = 500;
// A program such as timeout(1) tells the daemon and then its group, which is one wish.
constexpr int64_t kSameWishMs = 100;
constexpr int64_t kStartMs = 60'000;
constexpr uint32_t kMaxDeathsAtStart = 5;
// How long a child may take to end after SIGKILL: one whose file system does not answer never does.
constexpr int64_t kDyingMs = 5'000;
// Every connection takes a descriptor, and a relayed session several.
constexpr rlim_t kAmpleDescriptors = 4096;

class Supervisor {
 public:
  Supervisor(Listeners listeners, SharedState shared)
      : listeners_(std::move(listeners)), shared_(std::move(shared)) {}

  void AddChildren(const ServeOptions& options);
  int Run(int signal_fd);

 private:
  void StartDueChildren(int64_t now_ms);
  void ReapChildren(int64_t now_ms);
  // False when the daemon cannot start, because a child has refused to.
  bool AnnounceWhenReady(int64_t now_ms);
  void BeginDrain(int64_t now_ms);
  // Whether all have ended.
  bool KillAll();
  bool any_running() const;
  // The number of termination signals read.
  int ReadSignals(int signal_fd);

  Listeners listeners_;
  SharedState shared_;
  std::vector<ChildProcess> children_;
  bool announced_ = false;
  bool draining_ = false;
  int64_t drain_end_ms_ = 0;
};

void Supervisor::AddChildren(const ServeOptions& options) {
  ChildOptions common;
  static_cast<CommonOptions&>(common) = options;
  common.worker_ports = listeners_.worker_ports;
  common.dataset_port = listeners_.dataset_port;
  for (const auto& worker : listeners_.workers) {
    // The gateway reaches a worker at its last address, which is ipc if the worker has one.
    common.worker_addresses.push_back(LocalAddress(worker.back()));
  }
  common.dataset_address = LocalAddress(listeners_.dataset.back());
  const auto add = [&](uint32_t child, std::string role, uint32_t index,
                       const std::vector<ListeningEndpoint>& endpoints) {
    ChildOptions child_options = common;
    child_options.role = std::move(role);
    child_options.index = index;
    child_options.endpoints = endpoints;
    const bool has_door = child >= kFirstWorkerChild && !listeners_.doors.empty();
    if (has_door) child_options.door_listener = listeners_.doors[index];
    children_.emplace_back(child, std::move(child_options), &shared_);
  };
  for (uint32_t i = 0; i < listeners_.workers.size(); ++i) {
    add(kFirstWorkerChild + i, "worker", i, listeners_.workers[i]);
  }
  add(kGatewayChild, "gateway", 0, listeners_.gateway);
  add(kDatasetChild, "dataset-worker", 0, listeners_.dataset);
}

void Supervisor::StartDueChildren(int64_t now_ms) {
  for (ChildProcess& child : children_) {
    if (child.running() || now_ms < child.restart_at_ms()) continue;
    if (const Status status = child.Start(); !status.ok()) spdlog::error(status.ToString());
  }
}

void Supervisor::ReapChildren(int64_t now_ms) {
  for (ChildProcess& child : children_) {
    std::optional<Death> death = child.Reap();
    if (!death) death = child.AbandonRemains(now_ms);
    if (death && child.child() >= kFirstWorkerChild) {
      BlameDeath(shared_, child.child() - kFirstWorkerChild, *death);
    }
  }
  std::vector<pid_t> children;
  for (const ChildProcess& child : children_) children.push_back(child.process_id());
  ReapStrangers(children);
}

bool Supervisor::AnnounceWhenReady(int64_t now_ms) {
  if (announced_) return true;
  for (const ChildProcess& child : children_) {
    // An exit before the first beat is a refusal that was explained on stderr; a second try would
    // be refused too.
    const bool refused = child.deaths_before_ready() > 0 && child.last_exit_code() >= 0;
    if (refused || child.deaths_before_ready() >= kMaxDeathsAtStart ||
        (!child.ready() && now_ms - shared_.header().start_ms > kStartMs)) {
      spdlog::error("{} does not start", ChildName(child.child()));
      return false;
    }
  }
  announced_ = std::all_of(children_.begin(), children_.end(),
                           [](const ChildProcess& child) { return child.ready(); });
  if (announced_) {
    for (const ListeningEndpoint& endpoint : listeners_.gateway) {
      std::fputs(fmt::format("ready {}\n", endpoint.address).c_str(), stdout);
    }
    // Clients are served, too, where nobody reads this: it is no fault at the daemon's end.
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) std::clearerr(stdout);
    if (!TellServiceManager("READY=1")) {
      spdlog::warn("systemd cannot be told that the daemon is ready (NOTIFY_SOCKET)");
    }
  }
  return true;
}

void Supervisor::BeginDrain(int64_t now_ms) {
  spdlog::info("draining");
  (void)TellServiceManager("STOPPING=1");
  draining_ = true;
  drain_end_ms_ = now_ms + limits::kDrainMs;
  shared_.header().draining.store(true);
}

bool Supervisor::KillAll() {
  for (ChildProcess& child : children_) child.Kill();
  const Deadline deadline = Deadline::AfterMs(kDyingMs);
  while (any_running() && !deadline.expired()) {
    for (ChildProcess& child : children_) child.Reap();
    poll(nullptr, 0, 1);
  }
  for (const ChildProcess& child : children_) {
    if (!child.running()) continue;
    spdlog::error("{} (process {}) cannot be killed: does its file system answer?",
                  ChildName(child.child()), child.process_id());
  }
  return !any_running();
}

bool Supervisor::any_running() const {
  return std::any_of(children_.begin(), children_.end(),
                     [](const ChildProcess& child) { return child.running(); });
}

int Supervisor::ReadSignals(int signal_fd) {
  int terminations = 0;
  signalfd_siginfo info{};
  while (read(signal_fd, &info, sizeof(info)) == static_cast<ssize_t>(sizeof(info))) {
    if (info.ssi_signo != SIGCHLD) ++terminations;
  }
  return terminations;
}

int Supervisor::Run(int signal_fd) {
  int exit_code = kExitDone;
  int64_t last_tick_ms = MonotonicMs();
  while (!draining_ || any_running()) {
    pollfd waited{signal_fd, POLLIN, 0};
    const int64_t now_ms = MonotonicMs();
    if (!draining_) StartDueChildren(now_ms);
    poll(&waited, 1, kTickMs);
    const int64_t tick_ms = MonotonicMs();
    const bool paused = tick_ms - last_tick_ms > kPausedMs;
    last_tick_ms = tick_ms;
    ReapChildren(tick_ms);
    int terminations = ReadSignals(signal_fd);
    if (terminations > 0 && !draining_) BeginDrain(tick_ms);
    if (tick_ms < drain_end_ms_ - limits::kDrainMs + kSameWishMs) terminations = 0;
    if (draining_ && (terminations > 0 || tick_ms > drain_end_ms_)) {
      spdlog::warn("ending without waiting for {}", terminations > 0 ? "the drain" : "stragglers");
      break;
    }
    if (draining_) continue;
    for (ChildProcess& child : children_) {
      child.KillIfFrozen(tick_ms, paused);
      child.KillIfLarge(tick_ms);
    }
    if (!AnnounceWhenReady(tick_ms)) {
      exit_code = kExitBadInput;
      break;
    }
  }
  if (!KillAll()) exit_code = kExitFailed;
  RemoveSocketFiles(listeners_);
  return exit_code;
}

bool IsIgnored(int number) {
  struct sigaction action {};
  return sigaction(number, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

// SIGCHLD wakes the loop; SIGTERM, SIGINT, SIGQUIT and SIGHUP (the terminal was closed) begin the
// drain, the last three unless the parent ignored them, as nohup and a script's `&` do: signalfd
// would report them all the same. SIGUSR1 and SIGUSR2, by which other daemons open their logs
// again, mean nothing here, and end nothing.
int OpenSignals() {
  signal(SIGCHLD, SIG_DFL);  // ignored by a parent, it would leave no child's end to wait for
  signal(SIGUSR1, SIG_IGN);
  signal(SIGUSR2, SIG_IGN);
  sigset_t signals;
  sigemptyset(&signals);
  for (const int number : {SIGCHLD, SIGTERM}) sigaddset(&signals, number);
  for (const int number : {SIGINT, SIGQUIT, SIGHUP}) {
    if (!IsIgnored(number)) sigaddset(&signals, number);
  }
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
}

// Fills the places of standard streams that are closed. What is opened later would take them, and
// the children's own streams would overwrite it.
void FillStandardStreams() {
  int fd = open("/dev/null", O_RDWR);
  while (fd >= 0 && fd <= STDERR_FILENO) fd = open("/dev/null", O_RDWR);
  if (fd > STDERR_FILENO) close(fd);
}

// At the limit of descriptors ZeroMQ's thread spins, so take all that the system grants.
void RaiseDescriptorLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_cur >= kAmpleDescriptors) return;
  spdlog::warn(
      "at most {} files may be open at once (ulimit -Hn): as many connections keep others waiting",
      limit.rlim_cur);
}

}  // namespace

int RunSupervisor(const ServeOptions& options) {
  FillStandardStreams();
  RaiseDescriptorLimit();
  signal(SIGPIPE, SIG_IGN);
  const int signal_fd = OpenSignals();
  Result<Listeners> listeners = OpenListeners(options);
  if (!listeners.ok()) {
    spdlog::error(listeners.status().message());
    return listeners.status().code() == StatusCode::kIoError ? kExitBadInput : kExitBadUsage;
  }
  const int64_t lease_ms = options.lease_seconds > 0  ? int64_t{options.lease_seconds} * 1000
                           : listeners->loopback_only ? limits::kLoopbackLeaseMs
                                                      : limits::kRemoteLeaseMs;
  Result<SharedState> shared = SharedState::Create(options.workers, lease_ms);
  if (!shared.ok()) {
    RemoveSocketFiles(*listeners);
    spdlog::error(shared.status().message());
    return kExitBadInput;
  }
  spdlog::default_logger()->set_pattern(std::string(kLogTime) + "b4mrl serve: %v");
  Supervisor supervisor(std::move(*listeners), std::move(*shared));
  supervisor.AddChildren(options);
  return supervisor.Run(signal_fd);
}

}  // namespace b4mrl
