#include "benchmarks/jobs/job.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <utility>

#include "proto/base/child_program.h"
#include "proto/base/exit_codes.h"

namespace b4mrl {
namespace {

constexpr int kPollMs = 10;
// For a checkpoint of a large replay buffer on a slow disk.
constexpr int64_t kToolGraceMs = 300'000;

UniqueFd OpenClaim(const std::string& path) {
  return UniqueFd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
}

// Signals that tell a process to stop.
sigset_t StopSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  return signals;
}

// What the new process does between fork and exec: system calls alone. It begins with the stop
// signals blocked, so that one that is sent early is not lost to a handler of the runner's.
// An `inherited` descriptor, if it is not negative, stays open.
[[noreturn]] void BecomeProgram(pid_t parent, int log, int inherited, char* const* argv,
                                char* const* environment) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(127);  // the runner died before it could be watched
  signal(SIGINT, SIG_DFL);
  signal(SIGTERM, SIG_DFL);
  signal(SIGXFSZ, SIG_DFL);  // which the runner ignores, as a user's own learner need not
  const sigset_t stop = StopSignals();
  sigprocmask(SIG_UNBLOCK, &stop, nullptr);
  TakeStreams(log, log, inherited);
  execve(argv[0], argv, environment);
  _exit(127);
}

}  // namespace

Result<UniqueFd> Claim(const std::string& path) {
  UniqueFd claim = OpenClaim(path);
  if (!claim.valid()) return IoError("make", path, errno);
  if (flock(claim.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) return UniqueFd();
    return Status(StatusCode::kUnsupported,
                  fmt::format("{} is on a file system without locks (flock)", path));
  }
  const UniqueFd second = OpenClaim(path);
  if (second.valid() && flock(second.get(), LOCK_EX | LOCK_NB) != 0) return claim;
  return Status(StatusCode::kUnsupported,
                fmt::format("{} is on a file system that grants a lock twice", path));
}

bool IsClaimed(const std::string& path) {
  const UniqueFd claim(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  return claim.valid() && flock(claim.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

JobOrder ToolOrder(std::vector<std::string> words, const std::string& log) {
  words.insert(words.begin(), ProgramBesideThisOne("b4mrl-tools"));
  return {.words = std::move(words), .log = log, .grace_ms = kToolGraceMs};
}

Result<Job> Job::Start(const JobOrder& order, UniqueFd claim) {
  std::vector<std::string> words = order.words;
  std::vector<std::string> variables = EnvironmentWith(order.environment);
  const std::vector<char*> argv = PointersTo(words), environment = PointersTo(variables);
  const UniqueFd out(open(order.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
  if (!out.valid()) return IoError("open", order.log, errno);
  const pid_t parent = getpid();
  const sigset_t stop = StopSignals();
  sigset_t before;
  sigprocmask(SIG_BLOCK, &stop, &before);
  const pid_t child = fork();
  const int inherited = order.stops_group && claim.valid() ? claim.get() : -1;
  if (child == 0) BecomeProgram(parent, out.get(), inherited, argv.data(), environment.data());
  const int error = errno;
  sigprocmask(SIG_SETMASK, &before, nullptr);
  if (child < 0) return IoError("start", order.words.front(), error);
  setpgid(child, child);  // so that Stop reaches the group even before the child made it itself
  return Job(child, order, std::move(claim));
}

Job::Job(Job&& other) noexcept
    : process_id_(std::exchange(other.process_id_, -1)),
      stops_group_(other.stops_group_),
      grace_ms_(other.grace_ms_),
      kill_at_(other.kill_at_),
      claim_(std::move(other.claim_)) {}

Job::~Job() {
  if (process_id_ > 0) {
    Stop();
    while (!Poll()) poll(nullptr, 0, kPollMs);
  }
  // To close the descriptor would not do: a process that has left the group, for a session of its
  // own, holds the lock by its copy as long as it lives.
  if (claim_.valid()) flock(claim_.get(), LOCK_UN);
}

std::optional<int> Job::Poll() {
  if (process_id_ <= 0) return kExitFailed;
  if (kill_at_ && kill_at_->expired()) kill(Addressee(), SIGKILL);
  siginfo_t ended{};
  if (waitid(P_PID, process_id_, &ended, WEXITED | WNOHANG | WNOWAIT) != 0) {
    if (errno != ECHILD) return std::nullopt;
    process_id_ = -1;  // somebody else has taken its code
    return kExitFailed;
  }
  if (ended.si_pid != process_id_) return std::nullopt;
  // Before the process is waited for, as its group's number is then free for others.
  if (stops_group_) kill(-process_id_, SIGKILL);
  int status = 0;
  waitpid(process_id_, &status, 0);
  process_id_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

void Job::Stop() {
  if (process_id_ <= 0) return;
  kill(Addressee(), SIGTERM);
  if (!kill_at_) kill_at_ = Deadline::AfterMs(grace_ms_);
}

}  // namespace b4mrl
