#include "server/supervisor/process_activity.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// Most work takes microseconds. A thread that is silent for longer than this is looked at more
// closely, which costs system calls.
constexpr int64_t kNoticeableMs = 200;

// Fields of /proc/PID/task/TID/stat that stand between the state and the processor times.
constexpr int kFieldsBetween = 10;

}  // namespace

std::optional<ThreadActivity> LookAtThread(pid_t process, pid_t thread) {
  std::string line;
  std::getline(std::ifstream(fmt::format("/proc/{}/task/{}/stat", process, thread)), line);
  // The state follows the program's name, which stands in parentheses and may hold some itself.
  const size_t name_end = line.rfind(") ");
  if (name_end == std::string::npos) return std::nullopt;
  std::istringstream fields(line.substr(name_end + 2));
  char state = 0;
  std::string skipped;
  int64_t user_ticks = 0, system_ticks = 0;
  fields >> state;
  for (int i = 0; i < kFieldsBetween; ++i) fields >> skipped;
  fields >> user_ticks >> system_ticks;
  if (!fields) return std::nullopt;
  static const int64_t ticks_per_second = sysconf(_SC_CLK_TCK);
  return ThreadActivity{.processor_ms = (user_ticks + system_ticks) * 1'000 / ticks_per_second,
                        .wants_processor = state == 'R' || state == 'D',
                        .stopped = state == 'T' || state == 't',
                        .ended = state == 'Z'};
}

bool HasOnlyRemains(pid_t process) {
  const std::optional<ThreadActivity> first = LookAtThread(process, process);
  return first && first->ended;
}

uint64_t OwnMemoryBytes(pid_t process) {
  std::ifstream file(fmt::format("/proc/{}/statm", process));
  uint64_t size = 0, resident = 0, shared = 0;
  file >> size >> resident >> shared;
  static const auto page_bytes = static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  return file && resident > shared ? (resident - shared) * page_bytes : 0;
}

bool WantsProcessor(pid_t process) {
  std::error_code error;
  std::filesystem::directory_iterator task(fmt::format("/proc/{}/task", process), error);
  for (; !error && task != std::filesystem::directory_iterator(); task.increment(error)) {
    const auto thread = static_cast<pid_t>(std::atoi(task->path().filename().c_str()));
    const std::optional<ThreadActivity> activity = LookAtThread(process, thread);
    if (activity && activity->wants_processor) return true;
  }
  return false;
}

Verdict Judge(const Silence& silence, int64_t limit_ms) {
  if (silence.ms < limit_ms) return Verdict::kPatience;
  if (silence.stopped) return Verdict::kHindered;
  if (!silence.wants_processor || silence.processor_ms >= limit_ms) return Verdict::kStuck;
  return silence.ms < limits::kStarvedChildMs ? Verdict::kPatience : Verdict::kHindered;
}

void ThreadWatch::Restart(int64_t now_ms) {
  since_ms_ = now_ms;
  processor_ms_.reset();
}

std::optional<Silence> ThreadWatch::Look(uint64_t sign, pid_t process, pid_t thread,
                                         int64_t now_ms) {
  if (sign != sign_) {
    sign_ = sign;
    Restart(now_ms);
  }
  Silence silence{.ms = now_ms - since_ms_};
  if (silence.ms < kNoticeableMs) return std::nullopt;
  const ThreadActivity activity = LookAtThread(process, thread).value_or(ThreadActivity{});
  if (!processor_ms_) processor_ms_ = activity.processor_ms;
  silence.processor_ms = activity.processor_ms - *processor_ms_;
  silence.wants_processor = activity.wants_processor;
  silence.stopped = activity.stopped;
  return silence;
}

}  // namespace b4mrl
