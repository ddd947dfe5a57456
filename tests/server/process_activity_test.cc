#include "server/process_activity.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>

#include "proto/base/clock.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 20'000;

// A forked process that runs `body`, killed at the end of the scope.
class Child {
 public:
  explicit Child(void (*body)()) : id_(fork()) {
    if (id_ != 0) return;
    body();
    _exit(0);
  }
  ~Child() { End(); }
  pid_t id() const { return id_; }
  void Stop() const {
    kill(id_, SIGSTOP);
    REQUIRE(waitpid(id_, nullptr, WUNTRACED) == id_);
  }
  void End() {
    if (id_ == 0) return;
    kill(id_, SIGKILL);
    waitpid(id_, nullptr, 0);
    id_ = 0;
  }

 private:
  pid_t id_;
};

void Spin() {
  while (true) {
    static volatile int turns = 0;
    turns = turns + 1;
  }
}
void Sleep() {
  while (true) pause();
}

template <typename Condition>
bool ComesTrue(Condition condition) {
  for (const Deadline deadline = Deadline::AfterMs(kPatienceMs); !deadline.expired();) {
    if (condition()) return true;
  }
  return false;
}

TEST_CASE("a process that computes wants a processor, and uses it, until it is stopped") {
  Child child(&Spin);
  CHECK(ComesTrue([&] { return ProcessorTimeMs(child.id()).value_or(0) >= 20; }));
  CHECK(WantsProcessor(child.id()));
  child.Stop();
  CHECK_FALSE(WantsProcessor(child.id()));
  const std::optional<int64_t> used = ProcessorTimeMs(child.id());
  CHECK(used >= 20);
  CHECK(used == ProcessorTimeMs(child.id()));
}

TEST_CASE("a process that sleeps wants no processor") {
  Child child(&Sleep);
  CHECK(ComesTrue([&] { return !WantsProcessor(child.id()); }));
}

TEST_CASE("nothing is known of a process that has ended") {
  Child child(&Sleep);
  const pid_t id = child.id();
  child.End();
  CHECK_FALSE(WantsProcessor(id));
  CHECK_FALSE(ProcessorTimeMs(id).has_value());
}

TEST_CASE("silence means frozen unless the process was kept from running") {
  constexpr int64_t kLimit = limits::kFrozenChildMs;
  CHECK_FALSE(IsFrozen({kLimit - 1, 0, false}, kLimit));
  CHECK_FALSE(IsFrozen({kLimit - 1, kLimit, true}, kLimit));
  CHECK(IsFrozen({kLimit, 0, false}, kLimit));            // asleep, deadlocked or stopped
  CHECK(IsFrozen({kLimit, kLimit, true}, kLimit));        // a step that never ends
  CHECK_FALSE(IsFrozen({kLimit, kLimit - 1, true}, kLimit));
  CHECK_FALSE(IsFrozen({limits::kStarvedChildMs - 1, 0, true}, kLimit));
  CHECK(IsFrozen({limits::kStarvedChildMs, 0, true}, kLimit));
}

}  // namespace
}  // namespace b4mrl
