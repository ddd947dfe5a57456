#include "client/interrupt.h"

#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>

namespace b4mrl {
namespace {

// How a process ends that gets the signal twice, and then ends with code 0 if it has noticed.
int EndAfterTwo(int number) {
  const pid_t child = fork();
  if (child == 0) {
    CatchInterrupts();
    raise(number);
    raise(number);
    _exit(Interrupted() ? 0 : 1);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  return status;
}

TEST_CASE("A second SIGINT ends a command at once, a second SIGTERM leaves it its time") {
  const int interrupted = EndAfterTwo(SIGINT);
  REQUIRE(WIFSIGNALED(interrupted));
  CHECK(WTERMSIG(interrupted) == SIGINT);
  const int terminated = EndAfterTwo(SIGTERM);
  REQUIRE(WIFEXITED(terminated));
  CHECK(WEXITSTATUS(terminated) == 0);
}

}  // namespace
}  // namespace b4mrl
