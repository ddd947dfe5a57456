// The threads of a worker, where the system grants too few.
#include "server/worker/executor.h"

#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <system_error>
#include <vector>

#include "tests/two_threads.h"

namespace b4mrl {
namespace {

TEST_CASE("A worker for which the system has too few threads is told so, and ends those it has") {
  constexpr int kTold = 7, kWrong = 8;
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    std::vector<ThreadMark> marks(kMarksPerWorker);
    if (!LeaveRoomForTwoThreads()) _exit(kWrong);
    try {
      const Executor executor(16, marks);
      _exit(kWrong);
    } catch (const std::system_error& error) {
      _exit(error.code() == std::errc::resource_unavailable_try_again ? kTold : kWrong);
    }
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == kTold);
}

}  // namespace
}  // namespace b4mrl
