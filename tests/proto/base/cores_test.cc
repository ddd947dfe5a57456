#include "proto/base/cores.h"

#include <sched.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <thread>

#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// A machine's files: the groups of its process, and what each group's folder says.
class Groups {
 public:
  explicit Groups(const std::string& of_process) { Write("proc/self/cgroup", of_process); }
  void Write(const std::string& path, const std::string& text) const {
    const std::string file = folder_.File(path);
    std::filesystem::create_directories(std::filesystem::path(file).parent_path());
    WriteBytes(file, text);
  }
  GroupLimits Read() const { return ReadGroupLimits(folder_.path()); }

 private:
  TemporaryFolder folder_;
};

TEST_CASE("A pinned thread stays on its core, and so do the threads that it starts") {
  const std::vector<int> before = AvailableCores();
  REQUIRE_FALSE(before.empty());
  {
    const ScopedPin pin(before.back());
    CHECK(AvailableCores() == std::vector<int>{before.back()});
    CHECK(sched_getcpu() == before.back());
    std::vector<int> of_child;
    std::thread([&] { of_child = AvailableCores(); }).join();
    CHECK(of_child == std::vector<int>{before.back()});
  }
  CHECK(AvailableCores() == before);
}

TEST_CASE("What Slurm grants bounds the threads, and no text that is none of its numbers does") {
  unsetenv("SLURM_CPUS_ON_NODE");  // of a job in which this runs
  const uint32_t all = ProcessorCount();
  const auto count_with = [](const char* granted) {
    setenv("SLURM_CPUS_ON_NODE", granted, 1);
    const uint32_t count = ProcessorCount();
    unsetenv("SLURM_CPUS_ON_NODE");
    return count;
  };
  CHECK(count_with("1") == 1);
  for (const char* text : {"1000000", "", "0", "-3", "x"}) CHECK(count_with(text) == all);
}

TEST_CASE("The tightest of the control groups around a process limits it") {
  const Groups groups("0::/outer/inner\n");
  const std::string outer = "sys/fs/cgroup/outer/", inner = outer + "inner/";
  groups.Write(outer + "cpu.max", "250000 100000\n");
  groups.Write(inner + "cpu.max", "300000 100000\n");
  groups.Write(outer + "memory.max", "6442450944\n");
  groups.Write(inner + "memory.max", "2147483648\n");
  CHECK(groups.Read().processors == 2.5);
  CHECK(groups.Read().memory_bytes == 2147483648);
  groups.Write(inner + "cpu.max", "100000 100000\n");
  CHECK(groups.Read().processors == 1);
  groups.Write(inner + "cpu.max", "max 100000\n");
  groups.Write(inner + "memory.max", "max\n");
  CHECK(groups.Read().processors == 2.5);
  CHECK(groups.Read().memory_bytes == 6442450944);
}

TEST_CASE("A container's group is at the mount, whatever its host calls it") {
  const Groups groups("0::/kubepods/pod1/container\n");
  groups.Write("sys/fs/cgroup/cpu.max", "50000 100000\n");
  groups.Write("sys/fs/cgroup/memory.max", "1073741824\n");
  CHECK(groups.Read().processors == 0.5);
  CHECK(groups.Read().memory_bytes == 1073741824);
}

TEST_CASE("Version 1 has a folder for each controller, and huge numbers for no limit") {
  const Groups groups("9:name=systemd:/\n4:memory:/job\n3:cpuset:/other\n2:cpu,cpuacct:/job\n");
  groups.Write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  CHECK(groups.Read().memory_bytes == std::numeric_limits<uint64_t>::max());
  groups.Write("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "3221225472\n");
  groups.Write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
  groups.Write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  groups.Write("sys/fs/cgroup/cpu/job/cpu.cfs_quota_us", "150000\n");
  groups.Write("sys/fs/cgroup/cpu/job/cpu.cfs_period_us", "100000\n");
  // Of a group of the same name as the process's group of another controller.
  groups.Write("sys/fs/cgroup/cpu/other/cpu.cfs_quota_us", "10000\n");
  groups.Write("sys/fs/cgroup/cpu/other/cpu.cfs_period_us", "100000\n");
  CHECK(groups.Read().processors == 1.5);
  CHECK(groups.Read().memory_bytes == 3221225472);
}

TEST_CASE("Groups that say nothing that can be read limit nothing") {
  for (const char* text : {"", "0::/\n", "no groups\n", "0:\n", "0::job\n"}) {
    const Groups groups(text);
    groups.Write("sys/fs/cgroup/cpu.max", "many\n");
    groups.Write("sys/fs/cgroup/memory.max", "");
    CHECK(std::isinf(groups.Read().processors));
    CHECK(groups.Read().memory_bytes == std::numeric_limits<uint64_t>::max());
  }
}

TEST_CASE("A process has a processor and memory, and no more than its machine") {
  CHECK(ProcessorCount() >= 1);
  CHECK(ProcessorCount() <= AvailableCores().size());
  CHECK(MemoryBytes() > 0);
  CHECK(MemoryBytes() < uint64_t{1} << 62);
  const ScopedPin pin(AvailableCores().back());
  CHECK(ProcessorCount() == 1);
}

}  // namespace
}  // namespace b4mrl
