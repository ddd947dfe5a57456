#include "algorithms/nn/thread_team.h"

#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <vector>

#include "algorithms/base/within_memory.h"
#include "tests/two_threads.h"

namespace b4mrl {
namespace {

TEST_CASE("A team does every piece once, whatever its size") {
  const int threads = GENERATE(1, 2, 5);
  const int pieces = GENERATE(0, 1, 2, 7, 100);
  ThreadTeam team(threads);
  CHECK(team.threads() == threads);
  for (int round = 0; round < 50; ++round) {  // a helper may be late from the round before
    std::vector<std::atomic<int>> done(pieces);
    std::atomic<bool> numbered = true;
    team.ForEach(pieces, [&](int piece, int thread) {
      ++done[piece];
      if (thread < 0 || thread >= threads) numbered = false;
    });
    REQUIRE(numbered);
    for (const std::atomic<int>& count : done) REQUIRE(count == 1);
  }
}

TEST_CASE("Two pieces run at the same time on two threads") {
  ThreadTeam team(2);
  std::atomic<int> begun = 0;
  // Each waits for the other to begin: one thread would never get through.
  team.ForEach(2, [&](int, int) {
    ++begun;
    while (begun < 2) std::this_thread::yield();
  });
  CHECK(begun == 2);
}

TEST_CASE("A team for which the system has too few threads is an error, not a crash") {
  constexpr int kRefused = 7, kWrong = 8;
  const pid_t child = fork();  // limits of a process cannot be raised again
  REQUIRE(child >= 0);
  if (child == 0) {
    if (!LeaveRoomForTwoThreads()) _exit(kWrong);
    const Status status = WithinMemory("this test", [] {
      const ThreadTeam team(16);
      return Status();
    });
    const bool says_why = status.message().find("threads") != std::string::npos;
    _exit(status.code() == StatusCode::kFailedPrecondition && says_why ? kRefused : kWrong);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == kRefused);
}

}  // namespace
}  // namespace b4mrl
