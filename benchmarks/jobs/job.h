// A child process of the runner: `b4mrl train`, `b4mrl dataset make`, `b4mrl evaluate` or a learner
// of the user's own, and the claim that keeps other runners away from its work until the job's
// object ends: what it made is kept by then.
//
// A claim is a lock on a file (flock), so that it ends with the process that holds it, however that
// dies. A learner also locks its run's folder itself; so a run whose runner was killed is not
// started a second time before its learner, told to stop by the kernel, has ended. A job's process
// is told to stop (SIGTERM) when the thread that started it ends. Thread rule: one thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// How often a job is begun that ends with an error.
inline constexpr int kMostAttempts = 2;

// Locks the file, which is made if it is missing. An invalid descriptor: another process holds it.
// kUnsupported if the file system grants a lock twice or none; kIoError.
Result<UniqueFd> Claim(const std::string& path);
// Whether a process holds the claim. A process that claims it at the same moment may be told that
// it is held.
bool IsClaimed(const std::string& path);

// What a job's process is to be.
struct JobOrder {
  std::vector<std::string> words;        // of the command; the first one is the program's path
  std::string log;                       // file to which both outputs are appended
  std::vector<std::string> environment;  // "NAME=value", beside this process's own
  // The processes that it has started belong to it: Stop reaches them too, those that are left when
  // it ends are killed, and if it is killed with its runner they keep the claim until they end. A
  // process that leaves the group lives on, but the claim ends with the job all the same.
  bool stops_group = false;
  // How long the process may take to save its work after Stop; then it is killed.
  int64_t grace_ms = 30'000;
};
// `b4mrl` with these words: the program beside this one that knows them.
JobOrder ToolOrder(std::vector<std::string> words, const std::string& log);

class Job {
 public:
  // Starts the process, in a group of its own, so that a terminal's Ctrl-C reaches the runner
  // alone.
  static Result<Job> Start(const JobOrder& order, UniqueFd claim);
  Job(Job&& other) noexcept;
  Job& operator=(Job&&) = delete;
  ~Job();  // stops the process and waits for it

  // The exit code if the process has ended, 128 + its number if a signal ended it. The claim stays.
  std::optional<int> Poll();
  // Tells the process to stop; it ends by itself, or is killed by Poll after the order's grace,
  // with stops_group also what is left of its processes.
  void Stop();
  bool was_stopped() const { return kill_at_.has_value(); }

 private:
  Job(pid_t process_id, const JobOrder& order, UniqueFd claim)
      : process_id_(process_id),
        stops_group_(order.stops_group),
        grace_ms_(order.grace_ms),
        claim_(std::move(claim)) {}

  pid_t Addressee() const { return stops_group_ ? -process_id_ : process_id_; }

  pid_t process_id_ = -1;  // -1 once it has ended
  bool stops_group_ = false;
  int64_t grace_ms_ = 0;
  std::optional<Deadline> kill_at_;
  UniqueFd claim_;
};

}  // namespace b4mrl
