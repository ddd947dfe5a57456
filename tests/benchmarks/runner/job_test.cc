// Claims end with their holders, and jobs are processes that can be told to stop.
#include "benchmarks/runner/job.h"

#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>

#include "proto/base/clock.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

TEST_CASE("What is claimed cannot be claimed again until its holder is gone") {
  const TemporaryFolder folder;
  const std::string path = folder.File("claim");
  {
    const UniqueFd claim = Take(Claim(path));
    CHECK(claim.valid());
    CHECK_FALSE(Take(Claim(path)).valid());
  }
  CHECK(Take(Claim(path)).valid());
  const pid_t holder = fork();
  REQUIRE(holder >= 0);
  if (holder == 0) {
    const auto claim = Claim(path);
    const bool held = claim.ok() && claim->valid();
    _exit(held ? 0 : 1);  // without letting go
  }
  int status = 0;
  REQUIRE(waitpid(holder, &status, 0) == holder);
  CHECK(status == 0);
  CHECK(Take(Claim(path)).valid());
}

TEST_CASE("A folder that is not there is an error and no claim") {
  CHECK(Claim("/nonexistent/claim").status().code() == StatusCode::kIoError);
}

int ExitCodeOf(Job& job) {
  std::optional<int> code;
  for (const Deadline deadline = Deadline::AfterMs(60'000); !code && !deadline.expired();) {
    code = job.Poll();
    sched_yield();
  }
  REQUIRE(code.has_value());
  return *code;
}

TEST_CASE("A job keeps its claim until its object ends, and its process's words are in the log") {
  const TemporaryFolder folder;
  {
    Job job = Take(Job::Start(ToolOrder({"train", "--algorithm", "none"}, folder.File("log")),
                              Take(Claim(folder.File("claim")))));
    CHECK(ExitCodeOf(job) == 2);
    CHECK_FALSE(Take(Claim(folder.File("claim"))).valid());
  }
  CHECK(Take(Claim(folder.File("claim"))).valid());
  CHECK(ReadBytes(folder.File("log")).find("none") != std::string::npos);
}

TEST_CASE("A program that is not there ends with code 127") {
  const TemporaryFolder folder;
  Job job = Take(Job::Start({.words = {"/nonexistent"}, .log = folder.File("log")}, UniqueFd()));
  CHECK(ExitCodeOf(job) == 127);
}

}  // namespace
}  // namespace b4mrl
