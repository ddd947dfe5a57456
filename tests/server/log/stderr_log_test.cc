// What a log does whose reader stands still, and that it leaves the reader's descriptor alone.
#include "server/log/stderr_log.h"

#include <fcntl.h>
#include <spdlog/logger.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <climits>
#include <memory>
#include <string>

#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// The two ends of a pipe or a stream socket. Reading never waits, writing does.
struct Ends {
  UniqueFd reader, writer;

  explicit Ends(std::array<int, 2> fds) : reader(fds[0]), writer(fds[1]) {
    REQUIRE(fcntl(fds[0], F_SETFL, O_NONBLOCK) == 0);
  }
  std::string ReadAll() const {
    std::string all;
    std::array<char, 4096> block;
    ssize_t got = 0;
    while ((got = read(reader.get(), block.data(), block.size())) > 0) {
      all.append(block.data(), static_cast<size_t>(got));
    }
    return all;
  }
};

Ends Pipe() {
  std::array<int, 2> fds{};
  REQUIRE(pipe(fds.data()) == 0);
  REQUIRE(fcntl(fds[1], F_SETPIPE_SZ, 4096) > 0);
  return Ends(fds);
}

Ends SocketPair() {
  std::array<int, 2> fds{};
  REQUIRE(socketpair(AF_UNIX, SOCK_STREAM, 0, fds.data()) == 0);
  return Ends(fds);
}

spdlog::logger LoggerTo(int fd) {
  spdlog::logger logger("test", std::make_shared<NonblockingSink>(fd));
  logger.set_pattern("log: %v");
  return logger;
}

size_t LinesOf(const std::string& text) {
  return static_cast<size_t>(std::ranges::count(text, '\n'));
}

TEST_CASE("A log that nobody reads drops lines instead of waiting, and says how many") {
  const Ends ends = GENERATE(0, 1) == 0 ? Pipe() : SocketPair();
  spdlog::logger logger = LoggerTo(ends.writer.get());
  constexpr size_t kLines = 100'000;
  const std::string text(95, 'x');
  for (size_t i = 0; i < kLines; ++i) logger.info(text);
  const std::string before = ends.ReadAll();
  const size_t written = LinesOf(before);
  CHECK(written > 0);
  CHECK(written < kLines);
  CHECK(before.size() == written * (5 + 95 + 1));  // all of them whole
  logger.info("read again");
  logger.info("and on");
  CHECK(ends.ReadAll() == "log: " + std::to_string(kLines - written) +
                              " lines of the log were dropped here, since nobody read them\n"
                              "log: read again\nlog: and on\n");
}

TEST_CASE("A log leaves the flags of a descriptor that others write to") {
  const Ends ends = Pipe();
  spdlog::logger logger = LoggerTo(ends.writer.get());
  logger.info("one");
  CHECK((fcntl(ends.writer.get(), F_GETFL) & O_NONBLOCK) == 0);
  CHECK(ends.ReadAll() == "log: one\n");
}

TEST_CASE("A line too long for one piece of a pipe is cut") {
  const Ends ends = Pipe();
  spdlog::logger logger = LoggerTo(ends.writer.get());
  logger.info(std::string(3 * PIPE_BUF, 'x'));
  const std::string line = ends.ReadAll();
  CHECK(line.size() == PIPE_BUF);
  CHECK(LinesOf(line) == 1);
  CHECK(line.ends_with("xxx...\n"));
}

TEST_CASE("A log into a file stands behind what others write through the same descriptor") {
  const TemporaryFolder folder;
  const std::string path = folder.File("log");
  const UniqueFd file(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  REQUIRE(file.valid());
  spdlog::logger logger = LoggerTo(file.get());
  logger.info("one");
  REQUIRE(write(file.get(), "two\n", 4) == 4);
  logger.info("three");
  CHECK(ReadBytes(path) == "log: one\ntwo\nlog: three\n");
}

TEST_CASE("A log whose reader is gone, or that is closed, loses its lines and nothing else") {
  Ends ends = Pipe();
  ends.reader.Reset();
  for (const int fd : {ends.writer.get(), -1}) {
    spdlog::logger logger = LoggerTo(fd);  // SIGPIPE would end this test
    logger.info("nobody");
  }
}

}  // namespace
}  // namespace b4mrl
