#include "proto/base/cores.h"

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "proto/base/count.h"

namespace b4mrl {
namespace {

// The numbers at the beginning of a file: none where it cannot be read or begins with "max".
std::vector<double> NumbersOf(const std::string& path) {
  std::ifstream file(path);
  std::vector<double> numbers;
  for (double number = 0; file >> number;) numbers.push_back(number);
  return numbers;
}

// Takes what one group allows, whichever version's files its folder has.
void Tighten(const std::string& folder, GroupLimits& limits) {
  for (const char* name : {"/memory.max", "/memory.limit_in_bytes"}) {
    const std::vector<double> bytes = NumbersOf(folder + name);
    // Version 1 writes a number near 2^63 where nothing limits the group.
    if (bytes.empty() || bytes[0] < 0 || bytes[0] >= 0x1p62) continue;
    limits.memory_bytes = std::min(limits.memory_bytes, static_cast<uint64_t>(bytes[0]));
  }
  std::vector<double> time = NumbersOf(folder + "/cpu.max");  // quota and period, in microseconds
  if (time.empty()) {
    time = NumbersOf(folder + "/cpu.cfs_quota_us");  // -1 for none
    const std::vector<double> period = NumbersOf(folder + "/cpu.cfs_period_us");
    time.insert(time.end(), period.begin(), period.end());
  }
  if (time.size() == 2 && time[0] > 0 && time[1] > 0) {
    limits.processors = std::min(limits.processors, time[0] / time[1]);
  }
}

}  // namespace

std::string ProcessorName() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    const size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

std::vector<int> AvailableCores() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cores;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) {
    for (int core = 0; core < CPU_SETSIZE; ++core) {
      if (CPU_ISSET(core, &set)) cores.push_back(core);
    }
  }
  if (cores.empty()) cores.push_back(0);
  return cores;
}

GroupLimits ReadGroupLimits(const std::string& root) {
  GroupLimits limits;
  std::ifstream groups(root + "/proc/self/cgroup");
  // "4:memory:/container/job" in version 1, a line for each controller, "0::/container/job" in 2.
  for (std::string line; std::getline(groups, line);) {
    const size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    std::string mount = root + "/sys/fs/cgroup";
    if (controllers == "cpu" || controllers.starts_with("cpu,") || controllers.ends_with(",cpu")) {
      mount += "/cpu";
    } else if (!controllers.empty()) {
      mount += "/" + controllers;
    }
    // The groups around it limit it, too. In a container they may have no folder, while the
    // container's own group is at the mount.
    for (std::string path = line.substr(second + 1); !path.empty();
         path.resize(std::min(path.rfind('/'), path.size() - 1))) {
      Tighten(mount + path, limits);
    }
    Tighten(mount, limits);
  }
  return limits;
}

uint32_t ProcessorCount() {
  double cores = static_cast<double>(AvailableCores().size());
  const char* const granted = std::getenv("SLURM_CPUS_ON_NODE");
  const auto count = ParseCount(granted == nullptr ? "" : granted, 1, CPU_SETSIZE);
  if (count.ok()) cores = std::min(cores, static_cast<double>(*count));
  return static_cast<uint32_t>(std::ceil(std::min(cores, ReadGroupLimits().processors)));
}

uint64_t MemoryBytes() {
  const auto pages = static_cast<uint64_t>(std::max(sysconf(_SC_PHYS_PAGES), 1l));
  const uint64_t machine = pages * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  return std::min(machine, ReadGroupLimits().memory_bytes);
}

void PinThisThread(const std::vector<int>& cores) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int core : cores) CPU_SET(core, &set);
  sched_setaffinity(0, sizeof(set), &set);
}

}  // namespace b4mrl
