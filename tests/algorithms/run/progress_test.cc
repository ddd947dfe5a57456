// The line of progress on a terminal.
#include "algorithms/base/progress.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <string>

#include "proto/base/unique_fd.h"

namespace b4mrl {
namespace {

// Stderr is a terminal of so many columns while it lives.
class Terminal {
 public:
  explicit Terminal(unsigned short columns) : master_(posix_openpt(O_RDWR | O_NOCTTY)) {
    REQUIRE(master_.valid());
    REQUIRE((grantpt(master_.get()) == 0 && unlockpt(master_.get()) == 0));
    const UniqueFd slave(open(ptsname(master_.get()), O_RDWR | O_NOCTTY));
    const winsize size = {24, columns, 0, 0};
    REQUIRE(ioctl(master_.get(), TIOCSWINSZ, &size) == 0);
    dup2(slave.get(), STDERR_FILENO);
  }
  ~Terminal() { dup2(before_.get(), STDERR_FILENO); }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  // What has been written, or ""; at most a few lines.
  std::string Shown() {
    pollfd waited{master_.get(), POLLIN, 0};
    std::array<char, 4096> block{};
    if (poll(&waited, 1, 0) <= 0) return "";
    const ssize_t count = read(master_.get(), block.data(), block.size());
    return {block.data(), static_cast<size_t>(std::max<ssize_t>(count, 0))};
  }

 private:
  UniqueFd before_{dup(STDERR_FILENO)};
  UniqueFd master_;
};

// The line that a terminal of so many columns shows of 500 of `total` updates, without the codes
// around it.
std::string LineOn(unsigned short columns, uint64_t total = 1000) {
  Terminal terminal(columns);
  Progress progress;
  progress.Start("train", "updates", total);
  std::string shown;
  while (shown.empty()) {  // a tenth of a second, then the line is drawn
    progress.Update(500, "score 31.2");
    shown = terminal.Shown();
  }
  const size_t begin = shown.find('\r'), end = shown.find("\x1b[K", begin);
  REQUIRE(end != std::string::npos);
  return shown.substr(begin + 1, end - begin - 1);
}

// Containers may have none: no file system of them is mounted.
bool HasPseudoTerminals() { return UniqueFd(posix_openpt(O_RDWR | O_NOCTTY)).valid(); }

TEST_CASE("A narrow terminal shows progress without its bar, and no more than fits") {
  if (!HasPseudoTerminals()) {
    WARN("skipped: this machine has no pseudo-terminals");
    return;
  }
  const std::string wide = LineOn(200);
  CHECK(wide.starts_with("train [############............] 500/1000 updates, "));
  CHECK(wide.ends_with("score 31.2"));
  const std::string middle = LineOn(80);
  CHECK(middle.starts_with("train 500/1000 updates, "));
  CHECK(middle.ends_with("score 31.2"));
  CHECK(LineOn(20) == "train 500/1000 upda");  // the cursor takes the last column
  CHECK(LineOn(0).size() > 80);                // a terminal that does not tell its width
  const std::string endless = LineOn(200, 0);  // nobody knows how many updates there will be
  CHECK(endless.starts_with("train 500 updates, "));
  CHECK(endless.ends_with(" so far, score 31.2"));
}

}  // namespace
}  // namespace b4mrl
