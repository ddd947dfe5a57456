#include "server/child_process.h"

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
#include <set>
#include <utility>

#include "server/options.h"
#include "server/process_activity.h"

namespace b4mrl {
namespace {

// A process that lived shorter than this died young: its restarts are spaced out.
constexpr int64_t kYoungMs = 250;
constexpr int64_t kFirstBackOffMs = 10;
constexpr int64_t kLongestBackOffMs = 5'000;
// Loading the libraries and adopting sessions may take this long.
constexpr int64_t kStartingMs = 20'000;

// Runs in the forked child until exec: async-signal-safe calls only.
[[noreturn]] void BecomeChild(pid_t supervisor, const std::vector<int>& kept_fds,
                              char* const* arguments) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != supervisor) _exit(1);  // it died before prctl
  signal(SIGINT, SIG_IGN);
  signal(SIGTERM, SIG_IGN);
  signal(SIGHUP, SIG_IGN);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  const int null = open("/dev/null", O_RDONLY);
  dup2(null, STDIN_FILENO);
  dup2(STDERR_FILENO, STDOUT_FILENO);  // stdout is the supervisor's: it says "ready"
  for (const int fd : kept_fds) fcntl(fd, F_SETFD, 0);
  execv("/proc/self/exe", arguments);
  _exit(127);
}

uint32_t BlameFor(Death death) { return death == Death::kKilled ? kKillBlame : kCrashBlame; }

}  // namespace

ChildProcess::ChildProcess(uint32_t child, ChildOptions options, SharedState* shared)
    : child_(child), options_(std::move(options)), shared_(shared) {}

Status ChildProcess::Start() {
  std::vector<std::string> arguments = ChildArguments(options_, shared_->fd());
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  std::vector<int> kept_fds = {shared_->fd()};
  for (const ListeningEndpoint& endpoint : options_.endpoints) kept_fds.push_back(endpoint.fd);

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
  started_ms_ = MonotonicMs();
  NoteBeat(started_ms_);
  beat_at_start_ = last_beat_;
  return Status();
}

std::optional<Death> ChildProcess::Reap() {
  int wait_status = 0;
  if (!running() || waitpid(process_id_, &wait_status, WNOHANG) != process_id_) return std::nullopt;
  process_id_ = 0;
  ChildRecord& record = shared_->child(child_);
  record.process_id.store(0);
  last_exit_code_ = WIFEXITED(wait_status) ? WEXITSTATUS(wait_status) : -1;
  if (!ready()) ++deaths_before_ready_;
  const bool killed = WIFSIGNALED(wait_status) && WTERMSIG(wait_status) == SIGKILL;
  const Death death = killed_as_frozen_ ? Death::kFrozen
                      : killed          ? Death::kKilled
                                        : Death::kCrashed;
  ScheduleRestart(death);
  if (!killed_as_frozen_ && !shared_->header().draining.load()) {
    spdlog::warn("{} ended ({} {})", ChildName(child_),
                 WIFSIGNALED(wait_status) ? "signal" : "exit code",
                 WIFSIGNALED(wait_status) ? WTERMSIG(wait_status) : last_exit_code_);
  }
  return death;
}

void ChildProcess::ScheduleRestart(Death death) {
  const int64_t now = MonotonicMs();
  const bool own_fault = death != Death::kKilled || !ready();
  young_deaths_ = own_fault && now - started_ms_ < kYoungMs ? young_deaths_ + 1 : 0;
  int64_t delay = 0;
  if (young_deaths_ > 1) {
    const uint32_t doublings = std::min(young_deaths_ - 2, 16u);
    delay = std::min(kFirstBackOffMs << doublings, kLongestBackOffMs);
  }
  restart_at_ms_ = now + delay;
  ++shared_->child(child_).restarts;
}

void ChildProcess::NoteBeat(int64_t now_ms) {
  last_beat_ = shared_->child(child_).heartbeat.load();
  last_beat_ms_ = now_ms;
  processor_ms_at_beat_ = ProcessorTimeMs(process_id_).value_or(0);
  starvation_logged_ = false;
}

void ChildProcess::KillIfFrozen(int64_t now_ms, bool paused) {
  if (!running() || killed_as_frozen_) return;
  if (paused || shared_->child(child_).heartbeat.load() != last_beat_) return NoteBeat(now_ms);
  const int64_t limit = ready() ? limits::kFrozenChildMs : kStartingMs;
  Silence silence{.ms = now_ms - last_beat_ms_};
  if (silence.ms < limit) return;
  silence.processor_ms = ProcessorTimeMs(process_id_).value_or(0) - processor_ms_at_beat_;
  silence.wants_processor = WantsProcessor(process_id_);
  if (!IsFrozen(silence, limit)) {
    if (!starvation_logged_) {
      spdlog::warn("{} has waited {} ms for a processor: the machine is overloaded",
                   ChildName(child_), silence.ms - silence.processor_ms);
      starvation_logged_ = true;
    }
    return;
  }
  spdlog::warn("{} has not answered for {} ms and is replaced", ChildName(child_), silence.ms);
  killed_as_frozen_ = true;
  Kill();
}

void ChildProcess::Kill() {
  if (running()) kill(process_id_, SIGKILL);
}

void BlameDeath(SharedState& shared, uint32_t worker, Death death) {
  const std::span<ThreadMark> marks = shared.marks(worker);
  const bool one_crashed = std::any_of(marks.begin(), marks.end(),
                                       [](const ThreadMark& mark) { return mark.crashed != 0; });
  const int64_t now = MonotonicMs();
  const uint32_t blame = BlameFor(death);
  // By session and request id: many threads may share one, whose blame is that of one death.
  std::set<std::pair<uint32_t, uint64_t>> queries;
  for (ThreadMark& mark : marks) {
    const bool accused = death == Death::kCrashed && one_crashed ? mark.crashed != 0
                         : death == Death::kFrozen
                             ? now - mark.since_ms >= limits::kFrozenChildMs / 2
                             : true;
    const MarkKind kind = mark.kind.load();
    if (accused && kind == MarkKind::kLane && mark.lane.load() < limits::kMaxLanes) {
      shared.lane(mark.lane.load()).AddBlame(mark.number.load(), mark.attempt.load(), blame);
    }
    if (accused && kind == MarkKind::kQuery && mark.session.load() < limits::kMaxSessions) {
      queries.emplace(mark.session.load(), mark.number.load());
    }
    mark.kind.store(MarkKind::kIdle);
    mark.crashed.store(0);
  }
  for (const auto& [session, request_id] : queries) {
    AddQueryBlame(shared.session(session), request_id, blame);
  }
}

}  // namespace b4mrl
