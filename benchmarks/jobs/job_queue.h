// What waits for a process and what has one, in the order in which it came. For programs that keep
// several jobs (job.h) under way. Thread rule: one thread.
#pragma once

#include <poll.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <iterator>
#include <list>
#include <optional>
#include <utility>

#include "benchmarks/jobs/job.h"
#include "proto/base/clock.h"

namespace b4mrl {

// Waits between two looks at the jobs.
inline constexpr int kJobPollMs = 200;

// When those that wait for another process are tried again: soon after something has changed here,
// else after twice the time as before, up to five seconds. Each try asks a file system that a
// cluster's tasks share.
class Patience {
 public:
  bool IsOver(size_t active, size_t waiting) {
    const bool has_changed = std::exchange(seen_, {active, waiting}) != std::pair(active, waiting);
    if (!has_changed && !next_.expired()) return false;
    wait_ms_ = has_changed ? kJobPollMs : std::min(2 * wait_ms_, kLongestMs);
    next_ = Deadline::AfterMs(wait_ms_);
    return true;
  }

 private:
  static constexpr int64_t kLongestMs = 5'000;
  std::pair<size_t, size_t> seen_;
  int64_t wait_ms_ = kJobPollMs;
  Deadline next_ = Deadline::AfterMs(0);
};

// Calls begin(task) -> bool for the tasks in turn while has_room(). Those for which it is
// false have to wait longer and keep their places; the others leave the queue.
template <typename Task, typename HasRoom, typename Begin>
void BeginWaiting(std::deque<Task>& waiting, HasRoom has_room, Begin begin) {
  std::deque<Task> later;
  while (!waiting.empty() && has_room()) {
    Task task = std::move(waiting.front());
    waiting.pop_front();
    if (!begin(task)) later.push_back(std::move(task));
  }
  waiting.insert(waiting.begin(), std::make_move_iterator(later.begin()),
                 std::make_move_iterator(later.end()));
}

// Calls finish(active, exit_code) for each of `active` whose member `job` has ended, and
// removes it afterwards, which lets go of its claim.
template <typename Active, typename Finish>
void CollectEnded(std::list<Active>& active, Finish finish) {
  for (auto each = active.begin(); each != active.end();) {
    const std::optional<int> exit_code = each->job.Poll();
    if (!exit_code) {
      ++each;
      continue;
    }
    finish(*each, *exit_code);
    each = active.erase(each);
  }
}

// Tells all of `active` to stop and waits for them together, as each may take its grace. `finish`
// is that of CollectEnded.
template <typename Active, typename Finish>
void StopAll(std::list<Active>& active, Finish finish) {
  for (Active& each : active) each.job.Stop();
  while (!active.empty()) {
    CollectEnded(active, finish);
    if (!active.empty()) poll(nullptr, 0, kJobPollMs);
  }
}

}  // namespace b4mrl
