#include "proto/wire/descriptors.h"

#include <fcntl.h>
#include <sys/socket.h>

#include <array>
#include <catch2/catch.hpp>
#include <cerrno>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

struct Ends {
  UniqueFd first;
  UniqueFd second;
};

Ends Connected() {
  int fds[2];
  REQUIRE(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) == 0);
  return {UniqueFd(fds[0]), UniqueFd(fds[1])};
}

// The first end reads, and reads the end of the file as soon as no copy of the second is open.
Ends Pipe() {
  int fds[2];
  REQUIRE(pipe2(fds, O_CLOEXEC | O_NONBLOCK) == 0);
  return {UniqueFd(fds[0]), UniqueFd(fds[1])};
}

bool HasWriter(const Ends& pipe) {
  char byte = 0;
  return read(pipe.first.get(), &byte, 1) != 0;
}

TEST_CASE("A descriptor arrives with its bytes and is the sender's file") {
  const Ends sockets = Connected();
  Ends pipe = Pipe();
  REQUIRE(SendWithDescriptors(sockets.first.get(), "abc", 3, std::array{pipe.second.get()}));
  pipe.second.Reset();
  std::string bytes(3, '\0');
  const UniqueFd passed =
      ReceiveWithDescriptor(sockets.second.get(), bytes.data(), bytes.size(), MSG_DONTWAIT);
  REQUIRE(passed.valid());
  CHECK(bytes == "abc");
  CHECK(fcntl(passed.get(), F_GETFD) == FD_CLOEXEC);
  REQUIRE(write(passed.get(), "x", 1) == 1);
  char byte = 0;
  REQUIRE(read(pipe.first.get(), &byte, 1) == 1);
  CHECK(byte == 'x');
}

TEST_CASE("A message with other than the expected bytes and one descriptor leaves none open") {
  const Ends sockets = Connected();
  const size_t sent_bytes = GENERATE(2, 3, 4);
  const size_t count = GENERATE(1, 2, 3, 8);
  if (sent_bytes == 3 && count == 1) return;
  CAPTURE(sent_bytes, count);
  std::vector<Ends> pipes;
  std::vector<int> fds;
  for (size_t i = 0; i < count; ++i) {
    pipes.push_back(Pipe());
    fds.push_back(pipes.back().second.get());
  }
  REQUIRE(SendWithDescriptors(sockets.first.get(), "abcd", sent_bytes, fds));
  for (Ends& pipe : pipes) pipe.second.Reset();
  std::string bytes(3, '\0');
  CHECK_FALSE(ReceiveWithDescriptor(sockets.second.get(), bytes.data(), bytes.size(), 0).valid());
  for (const Ends& pipe : pipes) CHECK_FALSE(HasWriter(pipe));
}

TEST_CASE("Bytes without a descriptor, the end and silence give none") {
  Ends sockets = Connected();
  char byte = 0;
  CHECK_FALSE(ReceiveWithDescriptor(sockets.second.get(), &byte, 1, MSG_DONTWAIT).valid());
  REQUIRE(send(sockets.first.get(), "x", 1, 0) == 1);
  CHECK_FALSE(ReceiveWithDescriptor(sockets.second.get(), &byte, 1, MSG_DONTWAIT).valid());
  sockets.first.Reset();
  CHECK_FALSE(ReceiveWithDescriptor(sockets.second.get(), &byte, 1, 0).valid());
}

TEST_CASE("Sending no descriptor, too many, or to nobody fails and says why") {
  Ends sockets = Connected();
  const std::vector<int> too_many(kMaxDescriptors + 1, sockets.first.get());
  CHECK_FALSE(SendWithDescriptors(sockets.first.get(), "x", 1, {}));
  CHECK(errno == EINVAL);
  CHECK_FALSE(SendWithDescriptors(sockets.first.get(), "x", 1, too_many));
  CHECK(errno == EINVAL);
  sockets.second.Reset();
  CHECK_FALSE(SendWithDescriptors(sockets.first.get(), "x", 1, std::array{sockets.first.get()}));
  CHECK(errno == EPIPE);
}

}  // namespace
}  // namespace b4mrl
