#include "benchmarks/performance/support/processor_time.h"

#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace b4mrl::perf {
namespace {

// The line of /proc/PID/stat after the name in parentheses, proc(5): state, parent, group, ten
// fields more, and the ticks in user and in kernel mode.
double SecondsIfOfGroup(const std::string& line, pid_t group) {
  const size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return 0;
  std::istringstream fields(line.substr(name_end + 1));
  std::string skipped;
  pid_t its_group = 0;
  long user_ticks = 0, kernel_ticks = 0;
  fields >> skipped >> skipped >> its_group;
  for (int i = 0; i < 8; ++i) fields >> skipped;
  fields >> user_ticks >> kernel_ticks;
  if (!fields || its_group != group) return 0;
  return static_cast<double>(user_ticks + kernel_ticks) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

double SecondsOf(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

}  // namespace

double ProcessorSecondsWith(pid_t group) {
  rusage own{};
  getrusage(RUSAGE_SELF, &own);
  double seconds = SecondsOf(own.ru_utime) + SecondsOf(own.ru_stime);
  std::error_code error;
  // Not a range-for, which would throw.
  for (std::filesystem::directory_iterator process("/proc", error), end; !error && process != end;
       process.increment(error)) {
    std::ifstream file(process->path() / "stat");
    std::string line;
    if (std::getline(file, line)) seconds += SecondsIfOfGroup(line, group);
  }
  return seconds;
}

double ThreadSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace b4mrl::perf
