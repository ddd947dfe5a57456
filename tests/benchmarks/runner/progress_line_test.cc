// The lines that a suite shows of itself: what becomes of them where nothing can be shown.
#include "benchmarks/runner/progress_line.h"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cstdio>
#include <string>

#include "proto/base/unique_fd.h"

namespace b4mrl {
namespace {

// While it lives, stderr is `fd`.
class StderrTo {
 public:
  explicit StderrTo(int fd) : before_(dup(STDERR_FILENO)) { dup2(fd, STDERR_FILENO); }
  ~StderrTo() {
    dup2(before_.get(), STDERR_FILENO);
    std::clearerr(stderr);
  }
  StderrTo(const StderrTo&) = delete;
  StderrTo& operator=(const StderrTo&) = delete;

 private:
  UniqueFd before_;
};

// A terminal that is nobody's: to close it sends no signal.
struct Terminal {
  UniqueFd master{posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)};
  UniqueFd slave;
  Terminal() {
    REQUIRE(grantpt(master.get()) == 0);
    REQUIRE(unlockpt(master.get()) == 0);
    std::array<char, 128> name{};
    REQUIRE(ptsname_r(master.get(), name.data(), name.size()) == 0);
    slave = UniqueFd(open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC));
    REQUIRE(slave.valid());
  }
};

TEST_CASE("A suite goes on when the terminal that shows it has gone") {
  Terminal terminal;
  const StderrTo shown(terminal.slave.get());
  ProgressLine line(false);
  line.Show("1 of 2 runs done");
  std::string text(64, '\0');
  const ssize_t got = read(terminal.master.get(), text.data(), text.size());
  CHECK(text.substr(0, got > 0 ? static_cast<size_t>(got) : 0) == "\r1 of 2 runs done\x1b[K");
  terminal.master.Reset();
  REQUIRE(write(STDERR_FILENO, "x", 1) < 0);
  CHECK_NOTHROW(line.Show("2 of 2 runs done"));
  CHECK_NOTHROW(line.Message("start HalfCheetah-sac-gravity-s0"));
}

TEST_CASE("A suite goes on when nothing more fits on the disk with its messages") {
  const UniqueFd full(open("/dev/full", O_WRONLY | O_CLOEXEC));
  const StderrTo shown(full.get());
  ProgressLine line(false);
  CHECK_NOTHROW(line.Message("start HalfCheetah-sac-gravity-s0"));
}

}  // namespace
}  // namespace b4mrl
