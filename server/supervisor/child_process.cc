#include "server/supervisor/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "proto/base/child_program.h"
#include "server/process/options.h"

namespace b4mrl {
namespace {

// A process that lived for a shorter time died young, and its restarts are spaced out.
constexpr int64_t kYoungMs = 250;
constexpr int64_t kFirstBackOffMs = 10;
constexpr int64_t kLongestBackOffMs = 5'000;
// Loading the libraries, or adopting one session, may take this long.
constexpr int64_t kStartingMs = 20'000;
constexpr int64_t kMemoryLookMs = 200;
constexpr int64_t kRemainsLookMs = 1'000;
constexpr int kCertainRemains = 3;  // looks: an ended process is waited for in milliseconds
constexpr int64_t kAbandonedBackOffMs = 60'000;

// Runs in the forked child until exec: async-signal-safe calls only.
[[noreturn]] void BecomeChild(pid_t supervisor, const std::vector<int>& kept_fds,
                              char* const* arguments) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != supervisor) _exit(1);  // the supervisor died before prctl
  signal(SIGINT, SIG_IGN);
  signal(SIGTERM, SIG_IGN);
  signal(SIGHUP, SIG_IGN);
  signal(SIGQUIT, SIG_IGN);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  const int null = open("/dev/null", O_RDONLY | O_CLOEXEC);
  dup2(null, STDIN_FILENO);
  dup2(STDERR_FILENO, STDOUT_FILENO);  // only the supervisor writes to stdout: "ready ..."
  for (const int fd : kept_fds) fcntl(fd, F_SETFD, 0);
  execv("/proc/self/exe", arguments);
  _exit(127);
}

}  // namespace

ChildProcess::ChildProcess(uint32_t child, ChildOptions options, SharedState* shared)
    : child_(child), options_(std::move(options)), shared_(shared) {}

Status ChildProcess::Start() {
  std::vector<std::string> arguments = ChildArguments(options_, shared_->fd());
  const std::vector<char*> pointers = PointersTo(arguments);
  std::vector<int> kept_fds = {shared_->fd()};
  for (const ListeningEndpoint& endpoint : options_.endpoints) kept_fds.push_back(endpoint.fd);
  if (options_.door_listener >= 0) kept_fds.push_back(options_.door_listener);

  ChildRecord& record = shared_->child(child_);
  const pid_t supervisor = getpid();
  const pid_t child = fork();
  if (child < 0) {
    const int error = errno;
    restart_at_ms_ = MonotonicMs() + kLongestBackOffMs;
    return IoError("start", ChildName(child_), error);
  }
  if (child == 0) BecomeChild(supervisor, kept_fds, pointers.data());
  process_id_ = child;
  record.process_id.store(child);
  killed_as_frozen_ = false;
  remains_ = 0;
  started_ms_ = MonotonicMs();
  RestartWatches(started_ms_);
  beat_at_start_ = record.heartbeat.load();
  return Status();
}

std::optional<Death> ChildProcess::Reap() {
  int wait_status = 0;
  if (!running() || waitpid(process_id_, &wait_status, WNOHANG) != process_id_) return std::nullopt;
  last_exit_code_ = WIFEXITED(wait_status) ? WEXITSTATUS(wait_status) : -1;
  const Death death = TakeLeave(WIFSIGNALED(wait_status) && WTERMSIG(wait_status) == SIGKILL);
  if (death != Death::kFrozen && !shared_->header().draining.load()) {
    spdlog::warn("{} ended ({} {})", ChildName(child_),
                 WIFSIGNALED(wait_status) ? "signal" : "exit code",
                 WIFSIGNALED(wait_status) ? WTERMSIG(wait_status) : last_exit_code_);
  }
  return death;
}

std::optional<Death> ChildProcess::AbandonRemains(int64_t now_ms) {
  if (!running() || now_ms < next_remains_look_ms_) return std::nullopt;
  next_remains_look_ms_ = now_ms + kRemainsLookMs;
  remains_ = killed_as_frozen_ || HasOnlyRemains(process_id_) ? remains_ + 1 : 0;
  if (remains_ < kCertainRemains) return std::nullopt;
  spdlog::error(
      "{} (process {}) was killed, does not end and is abandoned: does its file system "
      "answer?",
      ChildName(child_), process_id_);
  last_exit_code_ = -1;
  const bool was_ready = ready();
  const Death death = TakeLeave(/*was_killed=*/true);
  // The next one is likely to stay as well.
  if (!was_ready) restart_at_ms_ = now_ms + kAbandonedBackOffMs;
  return death;
}

Death ChildProcess::TakeLeave(bool was_killed) {
  process_id_ = 0;
  shared_->child(child_).process_id.store(0);
  if (!ready()) ++deaths_before_ready_;
  const Death death = killed_as_frozen_ ? Death::kFrozen
                      : was_killed      ? Death::kKilled
                                        : Death::kCrashed;
  ScheduleRestart(death);
  return death;
}

void ChildProcess::ScheduleRestart(Death death) {
  const int64_t now = MonotonicMs();
  young_deaths_ = death != Death::kKilled && now - started_ms_ < kYoungMs ? young_deaths_ + 1 : 0;
  int64_t delay = 0;
  if (young_deaths_ > 1) {
    const uint32_t doublings = std::min(young_deaths_ - 2, 16u);
    delay = std::min(kFirstBackOffMs << doublings, kLongestBackOffMs);
  }
  restart_at_ms_ = now + delay;
  ++shared_->child(child_).restarts;
}

std::span<ThreadMark> ChildProcess::marks() const {
  if (child_ < kFirstWorkerChild) return {};
  const std::span<ThreadMark> all = shared_->marks(child_ - kFirstWorkerChild);
  const size_t used = size_t{options_.threads} + 1;  // and the stand-in (executor.h)
  return all.first(std::min(used, all.size()));
}

void ChildProcess::RestartWatches(int64_t now_ms) {
  main_loop_.Restart(now_ms);
  work_.resize(marks().size());
  for (ThreadWatch& watch : work_) watch.Restart(now_ms);
}

bool ChildProcess::FindFrozenLoop(int64_t now_ms, int64_t limit_ms) {
  uint64_t sign = shared_->child(child_).heartbeat.load();
  // Until its first beat an environment worker takes over sessions. There may be a thousand, and
  // each that it begins to build is a sign of life.
  if (!ready() && !marks().empty()) sign += static_cast<uint64_t>(marks()[0].since_ms);
  std::optional<Silence> silence = main_loop_.Look(sign, process_id_, process_id_, now_ms);
  if (!silence) {
    starvation_logged_ = false;
    return false;
  }
  if (silence->ms < limit_ms) return false;
  // The main loop may wait for a lock whose holder, another thread, gets no processor.
  silence->wants_processor = silence->wants_processor || WantsProcessor(process_id_);
  const Verdict verdict = Judge(*silence, limit_ms);
  if (verdict == Verdict::kPatience) {
    if (!starvation_logged_) {
      spdlog::warn("{} has waited {} ms for a processor or a disk: the machine is overloaded",
                   ChildName(child_), silence->ms - silence->processor_ms);
      starvation_logged_ = true;
    }
    return false;
  }
  spdlog::warn("{} has not answered for {} ms and is replaced", ChildName(child_), silence->ms);
  if (verdict == Verdict::kStuck && !marks().empty()) marks()[0].guilty.store(1);
  return true;
}

bool ChildProcess::FindStuckWork(int64_t now_ms, int64_t limit_ms) {
  bool stuck = false;
  for (size_t i = 0; i < work_.size(); ++i) {
    ThreadMark& mark = marks()[i];
    if (mark.kind == MarkKind::kIdle) continue;
    const std::optional<Silence> silence =
        work_[i].Look(static_cast<uint64_t>(mark.since_ms), process_id_, mark.thread_id, now_ms);
    if (!silence || Judge(*silence, limit_ms) != Verdict::kStuck) continue;
    spdlog::warn("{} has been at one piece of work for {} ms and is replaced", ChildName(child_),
                 silence->ms);
    mark.guilty.store(1);
    stuck = true;
  }
  return stuck;
}

void ChildProcess::KillIfFrozen(int64_t now_ms, bool paused) {
  if (!running() || killed_as_frozen_ || remains_ > 0) return;
  if (paused) return RestartWatches(now_ms);
  const int64_t limit_ms = ready() ? limits::kFrozenChildMs : kStartingMs;
  if (!FindStuckWork(now_ms, limit_ms) && !FindFrozenLoop(now_ms, limit_ms)) return;
  killed_as_frozen_ = true;
  Kill();
}

void ChildProcess::KillIfLarge(int64_t now_ms) {
  if (!running() || now_ms < next_memory_look_ms_) return;
  next_memory_look_ms_ = now_ms + kMemoryLookMs;
  const uint64_t mib = OwnMemoryBytes(process_id_) >> 20;
  if (mib <= options_.memory_mib) return;
  spdlog::warn("{} takes {} MiB of memory, more than {}, and is replaced", ChildName(child_), mib,
               options_.memory_mib);
  Kill();
}

void ChildProcess::Kill() {
  if (running()) kill(process_id_, SIGKILL);
}

void ReapStrangers(std::span<const pid_t> own) {
  siginfo_t dead{};
  while (waitid(P_ALL, 0, &dead, WEXITED | WNOHANG | WNOWAIT) == 0 && dead.si_pid != 0 &&
         std::ranges::find(own, dead.si_pid) == own.end()) {
    waitpid(dead.si_pid, nullptr, WNOHANG);
    dead.si_pid = 0;
  }
}

}  // namespace b4mrl
