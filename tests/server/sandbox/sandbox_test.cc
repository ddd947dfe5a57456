#include "server/sandbox/sandbox.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cerrno>
#include <functional>

#include "tests/data/temporary_folder.h"
#include "tests/loopback.h"

namespace b4mrl {
namespace {

// Runs `check` inside the sandbox of a forked child; 0 is success, anything else says what failed.
int InSandbox(const TemporaryFolder& folder, const std::function<int()>& check,
              bool alone = false) {
  SandboxOptions options;
  options.alone = alone;
  options.readable_paths = {folder.File("readable")};
  options.writable_folder = folder.File("folder");
  options.memory_bytes = 4ull << 30;
  options.cpu_seconds = 10;
  options.file_bytes = 1000;
  options.descriptors = 32;
  const pid_t child = fork();
  if (child == 0) _exit(EnterSandbox(options).ok() ? check() : 99);
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 100 + WTERMSIG(status);
}

bool CanOpen(const std::string& path, int flags) {
  const int fd = open(path.c_str(), flags, 0644);
  if (fd >= 0) close(fd);
  return fd >= 0;
}

TEST_CASE("the sandbox leaves one file to read and one folder to write, within limits") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("readable"), "data");
  WriteBytes(folder.File("other"), "secret");
  REQUIRE(mkdir(folder.File("folder").c_str(), 0755) == 0);
  // Without Landlock the rest must hold all the same.
  const bool confined =
      syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION) >= 1;
  if (!confined) WARN("this kernel has no Landlock");
  const int failed = InSandbox(folder, [&] {
    if (!CanOpen(folder.File("readable"), O_RDONLY)) return 1;
    if (confined && CanOpen(folder.File("readable"), O_WRONLY)) return 2;
    if (confined && CanOpen(folder.File("other"), O_RDONLY)) return 3;
    if (confined && CanOpen("/etc/passwd", O_RDONLY)) return 4;
    if (confined && CanOpen(folder.File("new"), O_WRONLY | O_CREAT)) return 5;
    if (confined && unlink(folder.File("other").c_str()) == 0) return 6;
    const int fd = open(folder.File("folder/new").c_str(), O_RDWR | O_CREAT, 0644);
    if (fd < 0) return 7;
    const std::string bytes(2000, 'x');
    if (write(fd, bytes.data(), bytes.size()) != 1000) return 8;
    if (write(fd, bytes.data(), bytes.size()) >= 0) return 9;
    if (rename(folder.File("folder/new").c_str(), folder.File("folder/newer").c_str()) != 0) {
      return 10;
    }
    rlimit cores{};
    getrlimit(RLIMIT_CORE, &cores);
    return cores.rlim_max == 0 ? 0 : 11;
  });
  CHECK(failed == 0);
}

TEST_CASE("the sandbox bounds memory, processor time and descriptors") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("readable"), "data");
  REQUIRE(mkdir(folder.File("folder").c_str(), 0755) == 0);
  const int failed = InSandbox(folder, [&] {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    const auto reserve = [](size_t bytes) {
      return mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED;
    };
    if (!reserve(1ull << 30)) return 1;
    if (reserve(4ull << 30)) return 2;
#endif
    rlimit time{};
    getrlimit(RLIMIT_CPU, &time);
    if (time.rlim_cur != 10) return 3;
    int opened = 0;
    while (opened < 100 && open(folder.File("readable").c_str(), O_RDONLY) >= 0) ++opened;
    return opened > 0 && opened < 32 && errno == EMFILE ? 0 : 4;
  });
  CHECK(failed == 0);
}

TEST_CASE("a sandbox for one process starts no other, unless it is root's") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("readable"), "data");
  REQUIRE(mkdir(folder.File("folder").c_str(), 0755) == 0);
  const int failed = InSandbox(
      folder,
      [] {
        if (setuid(65534) != 0 && geteuid() == 0) return 0;  // root's children are not counted
        const pid_t other = fork();
        if (other == 0) _exit(0);
        if (other > 0) waitpid(other, nullptr, 0);
        return other < 0 ? 0 : 1;
      },
      /*alone=*/true);
  CHECK(failed == 0);
}

TEST_CASE("the sandbox connects to nobody") {
  constexpr int kFirstWithNetwork = 4;
  if (syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION) <
      kFirstWithNetwork) {
    WARN("skipped: this kernel's Landlock knows no networks");
    return;
  }
  const TemporaryFolder folder;
  WriteBytes(folder.File("readable"), "data");
  REQUIRE(mkdir(folder.File("folder").c_str(), 0755) == 0);
  const UniqueFd listener = ListenOnLoopback(0);
  REQUIRE(listener.valid());
  const uint16_t port = PortOf(listener);
  CHECK(ConnectToLoopback(port).valid());
  CHECK(InSandbox(folder, [port] { return ConnectToLoopback(port).valid() ? 1 : 0; }) == 0);
}

}  // namespace
}  // namespace b4mrl
