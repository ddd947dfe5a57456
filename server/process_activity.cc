#include "server/process_activity.h"

#include <fmt/format.h>
#include <time.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "proto/base/limits.h"

namespace b4mrl {

std::optional<int64_t> ProcessorTimeMs(pid_t process) {
  clockid_t clock{};
  timespec time{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &time) != 0) {
    return std::nullopt;
  }
  return time.tv_sec * 1'000 + time.tv_nsec / 1'000'000;
}

bool WantsProcessor(pid_t process) {
  std::error_code error;
  std::filesystem::directory_iterator task(fmt::format("/proc/{}/task", process), error);
  for (; !error && task != std::filesystem::directory_iterator(); task.increment(error)) {
    std::string line;
    std::getline(std::ifstream(task->path() / "stat"), line);
    // The state follows the name in parentheses, which may hold parentheses itself.
    const size_t name_end = line.rfind(") ");
    if (name_end == std::string::npos) continue;  // the thread has ended
    const char state = line[name_end + 2];
    if (state == 'R' || state == 'D') return true;
  }
  return false;
}

bool IsFrozen(const Silence& silence, int64_t limit_ms) {
  if (silence.ms < limit_ms) return false;
  const bool starved = silence.wants_processor && silence.processor_ms < limit_ms;
  return !starved || silence.ms >= limits::kStarvedChildMs;
}

}  // namespace b4mrl
