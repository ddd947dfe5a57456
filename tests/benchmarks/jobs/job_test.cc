// Claims end with their holders, and jobs are processes that can be told to stop.
#include "benchmarks/jobs/job.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <string>
#include <utility>

#include "benchmarks/jobs/evaluation_job.h"
#include "proto/base/clock.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

TEST_CASE("An evaluation's JSON is found among what its daemon says before and after it") {
  const TemporaryFolder folder;
  const std::string result = folder.File("result.json");
  const std::string json = R"({"agent":"a.h5","returns":[1.5,2.5]})";
  for (const char* before : {"", "[info] listening\n"}) {
    for (const char* after : {"", "\n", "\n[info] draining\n[info] bye\n"}) {
      CAPTURE(before, after);
      WriteBytes(LogOfEvaluation(result), before + json + after);
      RequireOk(KeepEvaluation(result));
      CHECK(ReadBytes(result) == json + "\n");
    }
  }
  for (const char* text : {"", "[info] draining\n", "{\"agent\":\"a.h5\"}\n"}) {
    CAPTURE(text);
    WriteBytes(LogOfEvaluation(result), text);
    CHECK(KeepEvaluation(result).code() == StatusCode::kDataLoss);
  }
}

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

// A pipe with a name, by which a test sees whether a process that has it open for writing lives.
class LifeSign {
 public:
  explicit LifeSign(std::string path) : path_(std::move(path)) {
    REQUIRE(mkfifo(path_.c_str(), 0600) == 0);
    fd_ = UniqueFd(open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
    REQUIRE(fd_.valid());
  }
  const std::string& path() const { return path_; }
  bool IsThere() const {
    char byte = 0;
    return read(fd_.get(), &byte, 1) != 0;
  }
  bool EndsSoon() const {
    for (const Deadline deadline = Deadline::AfterMs(60'000); !deadline.expired(); sched_yield()) {
      if (!IsThere()) return true;
    }
    return false;
  }

 private:
  std::string path_;
  UniqueFd fd_;
};

bool IsFreeSoon(const std::string& path) {
  for (const Deadline deadline = Deadline::AfterMs(60'000); !deadline.expired(); sched_yield()) {
    if (Take(Claim(path)).valid()) return true;
  }
  return false;
}

TEST_CASE("What a learner of the user's own leaves running ends with it") {
  const TemporaryFolder folder;
  const LifeSign left(folder.File("left"));
  const std::string begun = folder.File("begun");
  const std::string script = "(trap '' TERM; exec > " + left.path() + "; : > " + begun +
                             "; exec sleep 600) & until test -e " + begun + "; do :; done";
  Job job = Take(Job::Start(
      {.words = {"/bin/sh", "-c", script}, .log = folder.File("log"), .stops_group = true},
      UniqueFd()));
  CHECK(ExitCodeOf(job) == 0);
  CHECK(left.EndsSoon());
}

TEST_CASE("A process that a learner leaves in a session of its own keeps no claim") {
  const TemporaryFolder folder;
  const LifeSign left(folder.File("left"));
  const std::string claim = folder.File("claim"), begun = folder.File("begun"),
                    end = folder.File("end");
  REQUIRE(mkfifo(end.c_str(), 0600) == 0);
  const UniqueFd line(open(end.c_str(), O_RDWR | O_CLOEXEC));
  const std::string script = "setsid /bin/sh -c 'exec > " + left.path() + "; : > " + begun +
                             "; read -r line < " + end + "' & until test -e " + begun +
                             "; do :; done";
  {
    Job job = Take(Job::Start(
        {.words = {"/bin/sh", "-c", script}, .log = folder.File("log"), .stops_group = true},
        Take(Claim(claim))));
    CHECK(ExitCodeOf(job) == 0);
  }
  CHECK(left.IsThere());
  CHECK(Take(Claim(claim)).valid());
  REQUIRE(write(line.get(), "\n", 1) == 1);
  CHECK(left.EndsSoon());
}

TEST_CASE("A learner of the user's own that does not stop when it is told to is killed") {
  const TemporaryFolder folder;
  const std::string begun = folder.File("begun");
  Job job =
      Take(Job::Start({.words = {"/bin/sh", "-c", "trap '' TERM; : > " + begun + "; sleep 600"},
                       .log = folder.File("log"),
                       .stops_group = true,
                       .grace_ms = 50},
                      UniqueFd()));
  const Deadline deadline = Deadline::AfterMs(60'000);
  while (!std::filesystem::exists(begun) && !deadline.expired()) sched_yield();
  job.Stop();
  CHECK(ExitCodeOf(job) == 128 + SIGKILL);
}

TEST_CASE("A learner of the user's own that outlives its runner keeps its claim") {
  const TemporaryFolder folder;
  const std::string claim = folder.File("claim"), end = folder.File("end");
  REQUIRE(mkfifo(end.c_str(), 0600) == 0);
  const pid_t runner = fork();
  REQUIRE(runner >= 0);
  if (runner == 0) {
    const std::string script =
        "trap '' TERM; : > " + folder.File("begun") + "; read -r line < " + end;
    auto held = Claim(claim);
    const auto job = Job::Start(
        {.words = {"/bin/sh", "-c", script}, .log = folder.File("log"), .stops_group = true},
        held.ok() ? *std::move(held) : UniqueFd());
    while (job.ok() && !std::filesystem::exists(folder.File("begun"))) sched_yield();
    _exit(job.ok() ? 0 : 1);  // as if it was killed
  }
  int status = 0;
  REQUIRE(waitpid(runner, &status, 0) == runner);
  REQUIRE(status == 0);
  CHECK_FALSE(Take(Claim(claim)).valid());
  const UniqueFd line(open(end.c_str(), O_WRONLY | O_CLOEXEC));
  REQUIRE(write(line.get(), "\n", 1) == 1);
  CHECK(IsFreeSoon(claim));
}

}  // namespace
}  // namespace b4mrl
