#include "server/supervisor/child_process.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

// A child that has ended and was not waited for.
pid_t DeadChild() {
  const pid_t child = fork();
  if (child == 0) _exit(7);
  siginfo_t dead{};
  REQUIRE(waitid(P_PID, static_cast<id_t>(child), &dead, WEXITED | WNOWAIT) == 0);
  return child;
}

TEST_CASE("Dead processes that were inherited are waited for, and a child of one's own is left") {
  const pid_t stranger = DeadChild();
  ReapStrangers({});
  CHECK(waitpid(stranger, nullptr, WNOHANG) == -1);  // there is none any more
  const std::array<pid_t, 1> own = {DeadChild()};
  ReapStrangers(own);
  int status = 0;
  REQUIRE(waitpid(own[0], &status, WNOHANG) == own[0]);
  CHECK(WEXITSTATUS(status) == 7);
}

}  // namespace
}  // namespace b4mrl
