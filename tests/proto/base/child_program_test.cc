#include "proto/base/child_program.h"

#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/environment_variable.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 20'000;

std::span<const std::byte> Bytes(const std::string& text) { return std::as_bytes(std::span(text)); }

TEST_CASE("A program reads what is sent to it and ends when its input does") {
  ProgramOnSocket reader;
  REQUIRE(StartOnSocket("sh", {"sh", "-c", "read line && [ \"$line\" = hello ]"}, &reader) == 0);
  REQUIRE(SendAll(reader.socket.get(), Bytes("hello\n"), Deadline::AfterMs(kPatienceMs)).ok());
  reader.socket.Reset();
  REQUIRE(WaitForExit(reader.process_id, Deadline::AfterMs(kPatienceMs)) == 0);
}

TEST_CASE("A program that does not exist is the errno of that") {
  ProgramOnSocket none;
  REQUIRE(StartOnSocket("b4mrl-no-such-program", {"x"}, &none) == ENOENT);
  REQUIRE(none.process_id == 0);
}

TEST_CASE("A program that does not read or end is told from one that is gone") {
  ProgramOnSocket sleeper;
  REQUIRE(StartOnSocket("sleep", {"sleep", "1000"}, &sleeper) == 0);
  const std::string much(8 << 20, 'x');  // more than a socket's buffer holds
  const Status full = SendAll(sleeper.socket.get(), Bytes(much), Deadline::AfterMs(50));
  REQUIRE(full.code() == StatusCode::kDeadlineExceeded);
  const int wait_status = WaitForExit(sleeper.process_id, Deadline::AfterMs(50));
  REQUIRE(WIFSIGNALED(wait_status));
  REQUIRE(WTERMSIG(wait_status) == SIGKILL);
  const Status gone = SendAll(sleeper.socket.get(), Bytes(much), Deadline::AfterMs(kPatienceMs));
  REQUIRE(gone.code() == StatusCode::kUnavailable);
}

TEST_CASE("A program's output is read to its end, and its input is empty") {
  ProgramWithOutput writer;
  REQUIRE(StartWithOutput("sh", {"sh", "-c", "read line || echo empty"}, &writer) == 0);
  std::string text;
  char c = 0;
  while (read(writer.output.get(), &c, 1) == 1) text += c;
  CHECK(text == "empty\n");
  CHECK(WaitForExit(writer.process_id, Deadline::AfterMs(kPatienceMs)) == 0);

  ProgramWithOutput none;
  CHECK(StartWithOutput("b4mrl-no-such-program", {"x"}, &none) == ENOENT);
  CHECK(none.process_id == 0);
}

TEST_CASE("A program that is given variables has no others") {
  ProgramWithOutput program;
  const std::vector<std::string> variables = {"A=1", "B=2"};
  REQUIRE(StartWithOutput("env", {"env"}, &program, variables) == 0);
  std::string text;
  char c = 0;
  while (read(program.output.get(), &c, 1) == 1) text += c;
  CHECK(text == "A=1\nB=2\n");
  CHECK(WaitForExit(program.process_id, Deadline::AfterMs(kPatienceMs)) == 0);
}

TEST_CASE("A program is ended by files that grow too large, though this one is not") {
  const auto before = std::signal(SIGXFSZ, SIG_IGN);
  ProgramWithOutput program;
  const int error = StartWithOutput("grep", {"grep", "SigIgn", "/proc/self/status"}, &program);
  std::signal(SIGXFSZ, before);
  REQUIRE(error == 0);
  std::string text;
  char c = 0;
  while (read(program.output.get(), &c, 1) == 1) text += c;
  REQUIRE(WaitForExit(program.process_id, Deadline::AfterMs(kPatienceMs)) == 0);
  REQUIRE(text.starts_with("SigIgn:"));
  const uint64_t ignored = std::strtoull(text.c_str() + std::string("SigIgn:").size(), nullptr, 16);
  CHECK((ignored >> (SIGXFSZ - 1)) % 2 == 0);
}

TEST_CASE("A terminal's interrupt does not reach a program with an output of its own") {
  ProgramWithOutput other;
  REQUIRE(StartWithOutput("cat", {"cat", "/dev/zero"}, &other) == 0);
  CHECK(getpgid(other.process_id) == other.process_id);
  CHECK(getpgid(other.process_id) != getpgrp());
  CHECK(WIFSIGNALED(WaitForExit(other.process_id, Deadline::AfterMs(0))));
}

TEST_CASE("A temporary folder is new and nobody else's") {
  const Result<std::string> one = MakeTemporaryFolder("b4mrl-test");
  const Result<std::string> other = MakeTemporaryFolder("b4mrl-test");
  REQUIRE(one.ok());
  REQUIRE(other.ok());
  REQUIRE(*one != *other);
  struct stat info {};
  REQUIRE(stat(one->c_str(), &info) == 0);
  REQUIRE((info.st_mode & 0777) == 0700);
  std::filesystem::remove(*one);
  std::filesystem::remove(*other);
}

TEST_CASE("A temporary folder is in TMPDIR, unless that leaves no room for a socket's address") {
  const std::string base = *MakeTemporaryFolder("b4mrl-test");
  const std::string deep = base + "/" + std::string(100, 'd');
  std::filesystem::create_directory(deep);
  const EnvironmentVariable short_one("TMPDIR", base);
  CHECK(MakeTemporaryFolder("b4mrl-test")->starts_with(base + "/b4mrl-test-"));
  const EnvironmentVariable long_one("TMPDIR", deep);
  const Result<std::string> elsewhere = MakeTemporaryFolder("b4mrl-test");
  REQUIRE(elsewhere.ok());
  CHECK(std::filesystem::path(*elsewhere).parent_path() == "/tmp");
  std::filesystem::remove(*elsewhere);
  std::filesystem::remove_all(base);
}

}  // namespace
}  // namespace b4mrl
