#include "server/supervisor/process_activity.h"

#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <thread>

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

int64_t ProcessorMs(pid_t process) {
  const std::optional<ThreadActivity> activity = LookAtThread(process, process);
  REQUIRE(activity.has_value());
  return activity->processor_ms;
}

TEST_CASE("a thread that computes wants a processor, and uses it, until it is stopped") {
  Child child(&Spin);
  CHECK(ComesTrue([&] { return ProcessorMs(child.id()) >= 20; }));
  CHECK(WantsProcessor(child.id()));
  child.Stop();
  CHECK_FALSE(WantsProcessor(child.id()));
  CHECK(LookAtThread(child.id(), child.id())->stopped);
  const int64_t used = ProcessorMs(child.id());
  CHECK(used >= 20);
  CHECK(used == ProcessorMs(child.id()));
}

TEST_CASE("a thread that sleeps wants no processor, and is not stopped") {
  Child child(&Sleep);
  CHECK(ComesTrue([&] { return !WantsProcessor(child.id()); }));
  CHECK_FALSE(LookAtThread(child.id(), child.id())->stopped);
}

TEST_CASE("nothing is known of a thread that has ended") {
  Child child(&Sleep);
  const pid_t id = child.id();
  child.End();
  CHECK_FALSE(WantsProcessor(id));
  CHECK_FALSE(LookAtThread(id, id).has_value());
}

TEST_CASE("silence means frozen unless the thread was kept from running") {
  constexpr int64_t kLimit = limits::kFrozenChildMs;
  constexpr int64_t kStarved = limits::kStarvedChildMs;
  const auto judge = [](int64_t ms, int64_t processor_ms, bool wants_processor) {
    return Judge({ms, processor_ms, wants_processor, false}, kLimit);
  };
  CHECK(judge(kLimit - 1, 0, false) == Verdict::kPatience);
  CHECK(judge(kLimit - 1, kLimit, true) == Verdict::kPatience);
  CHECK(judge(kLimit, 0, false) == Verdict::kStuck);      // asleep or deadlocked
  CHECK(judge(kLimit, kLimit, true) == Verdict::kStuck);  // a step that never ends
  CHECK(judge(kLimit, kLimit - 1, true) == Verdict::kPatience);
  CHECK(judge(kStarved - 1, 0, true) == Verdict::kPatience);
  CHECK(judge(kStarved, 0, true) == Verdict::kHindered);
  CHECK(Judge({kLimit, 0, false, true}, kLimit) == Verdict::kHindered);  // stopped
}

TEST_CASE(
    "a thread under watch is charged with its own processor time alone, from its silence on") {
  Child busy(&Spin), asleep(&Sleep);
  REQUIRE(ComesTrue([&] { return ProcessorMs(busy.id()) >= 50; }));
  ThreadWatch watch, other;
  watch.Restart(0);
  other.Restart(0);
  CHECK_FALSE(watch.Look(7, busy.id(), busy.id(), 0));
  CHECK_FALSE(watch.Look(7, busy.id(), busy.id(), 100));
  const std::optional<Silence> noticed = watch.Look(7, busy.id(), busy.id(), 1'000);
  REQUIRE(noticed.has_value());
  CHECK(noticed->ms == 1'000);
  CHECK(noticed->processor_ms == 0);
  const int64_t used = ProcessorMs(busy.id());
  REQUIRE(ComesTrue([&] { return ProcessorMs(busy.id()) >= used + 50; }));
  CHECK(watch.Look(7, busy.id(), busy.id(), 2'000)->processor_ms >= 50);
  CHECK_FALSE(other.Look(7, asleep.id(), asleep.id(), 0));
  CHECK(other.Look(7, asleep.id(), asleep.id(), 2'000)->processor_ms == 0);
  SECTION("until it gets on") { CHECK_FALSE(watch.Look(8, busy.id(), busy.id(), 2'050)); }
  SECTION("until the watch begins anew") {
    watch.Restart(2'050);
    CHECK_FALSE(watch.Look(7, busy.id(), busy.id(), 2'100));
    CHECK(watch.Look(7, busy.id(), busy.id(), 3'050)->ms == 1'000);
  }
}

TEST_CASE("A process of which a thread goes on after its end has only remains") {
  const Child whole([] { pause(); });
  CHECK_FALSE(HasOnlyRemains(whole.id()));
  const Child ended([] {
    std::thread([] { pause(); }).detach();
    syscall(SYS_exit, 0);  // ends this thread alone
  });
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (!HasOnlyRemains(ended.id())) REQUIRE_FALSE(deadline.expired());
  CHECK(waitpid(ended.id(), nullptr, WNOHANG) == 0);  // it cannot be waited for
  CHECK_FALSE(HasOnlyRemains(INT32_MAX));
}

}  // namespace
}  // namespace b4mrl
