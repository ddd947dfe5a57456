// The frame of a program's main function: what becomes of output that cannot be written.
#include "proto/command_line/program.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <functional>
#include <string>
#include <system_error>

namespace b4mrl {
namespace {

constexpr int kThrew = 99;

struct Ending {
  int exit_code = -1;
  std::string err;
};

// RunProgram in a process of its own, whose stdout is `out` and which ignores SIGPIPE.
Ending RunIn(int out, const std::function<int()>& body) {
  std::array<int, 2> err{};
  REQUIRE(pipe2(err.data(), O_CLOEXEC) == 0);
  std::fflush(stdout);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    std::signal(SIGPIPE, SIG_IGN);
    dup2(out, STDOUT_FILENO);
    dup2(err[1], STDERR_FILENO);
    try {
      _exit(RunProgram("program", body));
    } catch (...) {
      _exit(kThrew);
    }
  }
  close(err[1]);
  Ending ending;
  std::array<char, 256> block{};
  for (ssize_t n = 0; (n = read(err[0], block.data(), block.size())) > 0;) {
    ending.err.append(block.data(), static_cast<size_t>(n));
  }
  close(err[0]);
  int status = 0;
  waitpid(child, &status, 0);
  ending.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return ending;
}

// A descriptor of which every write fails with EBADF, since it is for reading.
struct Unwritable {
  int fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
  ~Unwritable() { close(fd); }
};

std::function<int()> Prints(size_t bytes, int exit_code) {
  return [=] {
    std::fwrite(std::string(bytes, 'x').data(), 1, bytes, stdout);
    return exit_code;
  };
}

constexpr size_t kFew = 5;           // stay in stdout's buffer until it is flushed
constexpr size_t kMany = 1'000'000;  // do not fit it

TEST_CASE("A program whose output was not written ends with code 3 and says why") {
  const Unwritable out;
  const Ending few = RunIn(out.fd, Prints(kFew, 0));
  CHECK(few.exit_code == 3);
  CHECK(few.err == "program: cannot write stdout: Bad file descriptor\n");
  const Ending many = RunIn(out.fd, Prints(kMany, 0));
  CHECK(many.exit_code == 3);
  CHECK(many.err.starts_with("program: cannot write stdout: "));
  const Ending thrown = RunIn(out.fd, [] {
    std::fputs("x", stdout);
    std::fflush(stdout);  // fails, as within fmt::print, which then throws
    throw std::system_error(ENOSPC, std::generic_category());
    return 0;
  });
  CHECK(thrown.exit_code == 3);
  CHECK(thrown.err == "program: cannot write stdout: No space left on device\n");
}

TEST_CASE("A program that could not write to stderr does not blame stdout") {
  const Ending ending = RunIn(STDOUT_FILENO, [] {
    // As within fmt::print, whose stream remembers the error. What comes later can be written.
    const int before = dup(STDERR_FILENO);
    dup2(Unwritable().fd, STDERR_FILENO);
    std::fputs("x", stderr);
    dup2(before, STDERR_FILENO);
    throw std::system_error(EBADF, std::generic_category());
    return 0;
  });
  CHECK(ending.exit_code == 3);
  CHECK(ending.err == "program: cannot write stderr: Bad file descriptor\n");
}

TEST_CASE("A program that fails keeps its code, whatever becomes of its output") {
  const Unwritable out;
  CHECK(RunIn(out.fd, Prints(kFew, 5)).exit_code == 5);
  const Ending silent = RunIn(out.fd, Prints(0, 5));
  CHECK(silent.exit_code == 5);
  CHECK(silent.err.empty());
}

TEST_CASE("A program whose reader has gone ends without a word") {
  std::array<int, 2> ends{};
  REQUIRE(pipe2(ends.data(), O_CLOEXEC) == 0);
  close(ends[0]);
  const Ending ending = RunIn(ends[1], Prints(kFew, 0));
  close(ends[1]);
  CHECK(ending.exit_code == 128 + SIGPIPE);
  CHECK(ending.err.empty());
}

TEST_CASE("A file that grows beyond the limit on sizes is an error and no end of the program") {
  const int nothing = open("/dev/null", O_WRONLY | O_CLOEXEC);
  const Ending ending = RunIn(nothing, [] {
    std::FILE* const file = std::tmpfile();
    const rlimit limit{kFew, kFew};
    if (file == nullptr || setrlimit(RLIMIT_FSIZE, &limit) != 0) return 1;
    const std::string text(2 * kFew, 'x');
    if (write(fileno(file), text.data(), text.size()) != static_cast<ssize_t>(kFew)) return 2;
    return write(fileno(file), "x", 1) < 0 && errno == EFBIG ? 0 : 4;
  });
  close(nothing);
  CHECK(ending.exit_code == 0);
}

TEST_CASE("An error that has nothing to do with the output is not taken for one") {
  std::array<int, 2> ends{};
  REQUIRE(pipe2(ends.data(), O_CLOEXEC) == 0);
  const Ending ending =
      RunIn(ends[1], []() -> int { throw std::system_error(EAGAIN, std::generic_category()); });
  close(ends[0]);
  close(ends[1]);
  CHECK(ending.err.find("stdout") == std::string::npos);
  CHECK(ending.exit_code == kThrew);
}

}  // namespace
}  // namespace b4mrl
