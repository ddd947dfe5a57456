// Which model is compiled when, and what is remembered of it.
#include "server/gateway/model_queue.h"

#include <poll.h>

#include <catch2/catch.hpp>
#include <map>

#include "tests/server/models/compiler_script.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 30'000;

struct Fixture {
  CompilerScript script;
  ModelQueue queue{script.options()};
  std::map<uint64_t, Status> answers;

  Status Add(uint64_t number, const RoutingId& peer, const std::string& file) {
    script.Drop(file);
    return queue.Add(
        {number, peer, "Hopper", file,
         [this, number](const Result<std::string>& path) { answers[number] = path.status(); }});
  }
  // Pumps until `done`.
  template <typename Condition>
  void Await(const Condition& done) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!done() && !deadline.expired()) {
      queue.Pump();
      std::vector<int> fds;
      queue.AppendDescriptors(&fds);
      std::vector<pollfd> waiting;
      for (const int fd : fds) waiting.push_back({fd, POLLIN, 0});
      poll(waiting.data(), waiting.size(), 20);
    }
    REQUIRE(done());
  }
  StatusCode Ask(uint64_t number, const RoutingId& peer, const std::string& file) {
    RequireAdded(Add(number, peer, file));
    Await([&] { return answers.contains(number); });
    return answers[number].code();
  }
  static void RequireAdded(const Status& status) {
    INFO(status.ToString());
    REQUIRE(status.ok());
  }
};

TEST_CASE("Models that never end do not keep another connection's waiting") {
  Fixture fixture;
  for (uint64_t i = 0; i < 2 * limits::kModelCompilers; ++i) {
    const std::string name = "slow" + std::to_string(i);
    Fixture::RequireAdded(fixture.Add(i, name, name + ".xml"));
  }
  fixture.Await([&] { return fixture.script.runs() >= limits::kModelCompilers; });
  CHECK(fixture.Ask(100, "other", "good.xml") == StatusCode::kOk);
  CHECK(fixture.answers.size() == 1);  // those that made room still wait
  CHECK(fixture.Ask(101, "other", "refused.xml") == StatusCode::kInvalidArgument);
}

TEST_CASE("A connection's models are compiled one after another, beside those of others") {
  Fixture fixture;
  for (uint64_t i = 0; i < 4; ++i) {
    Fixture::RequireAdded(fixture.Add(i, "greedy", "slow" + std::to_string(i) + ".xml"));
  }
  CHECK(fixture.Ask(100, "other", "good.xml") == StatusCode::kOk);
  CHECK(fixture.script.runs() <= 2);  // one of theirs may not have come to its line yet
}

TEST_CASE("Taken or refused, a file is compiled again only when it has changed") {
  Fixture fixture;
  uint64_t number = 0;
  const auto ask = [&](const std::string& file) { return fixture.Ask(++number, "client", file); };
  for (int i = 0; i < 3; ++i) {
    CHECK(ask("refused.xml") == StatusCode::kInvalidArgument);
    CHECK(ask("good.xml") == StatusCode::kOk);
    fixture.script.Drop("other.xml", std::to_string(i));  // a neighbour changes nothing
  }
  CHECK(fixture.script.runs("refused.xml") == 1);
  CHECK(fixture.script.runs("good.xml") == 1);
}

TEST_CASE("What a file refers to may have changed, so it counts with its folder") {
  const CompilerScript script;
  ModelStore store(script.options());
  const std::atomic<bool> never{false};
  script.Drop("refused.xml", "<mujoco><include file='part.xml'/></mujoco>");
  script.Drop("part.xml", "a");
  for (int i = 0; i < 2; ++i) CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 1);
  script.Drop("part.xml", "bb");
  CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 2);
  script.Drop("refused.xml", "<mujoco/>");
  CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK_FALSE(store.Compile("Walker2d", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 4);
}

TEST_CASE("Models that wait are bounded, of a connection and of all") {
  Fixture fixture;
  uint64_t number = 0;
  const auto add = [&](const RoutingId& peer) {
    ++number;
    return fixture.Add(number, peer, "slow" + std::to_string(number) + ".xml").code();
  };
  for (uint32_t i = 0; i < limits::kMaxPendingModelsOfPeer; ++i) {
    REQUIRE(add("greedy") == StatusCode::kOk);
  }
  CHECK(add("greedy") == StatusCode::kLimitExceeded);
  for (uint32_t i = limits::kMaxPendingModelsOfPeer; i < limits::kMaxPendingModels; ++i) {
    REQUIRE(add("peer" + std::to_string(i)) == StatusCode::kOk);
  }
  CHECK(add("late") == StatusCode::kLimitExceeded);
  fixture.queue.Forget(1);  // of which none has begun
  CHECK(add("late") == StatusCode::kOk);
}

TEST_CASE("What nobody waits for any more is not begun, and its end told to nobody") {
  Fixture fixture;
  Fixture::RequireAdded(fixture.Add(1, "a", "slow1.xml"));
  Fixture::RequireAdded(fixture.Add(2, "b", "good1.xml"));
  fixture.queue.Forget(2);
  fixture.Await([&] { return fixture.script.runs("slow1.xml") == 1; });
  fixture.queue.Forget(1);
  CHECK(fixture.Ask(3, "c", "good2.xml") == StatusCode::kOk);
  CHECK(fixture.script.runs("good1.xml") == 0);
  CHECK(fixture.answers.size() == 1);
}

TEST_CASE("Names that no file can have, and unknown environments, are refused at once") {
  Fixture fixture;
  CHECK(fixture.Add(1, "a", "no.txt").code() == StatusCode::kInvalidArgument);
  CHECK(fixture.queue.Add({1, "a", "Hoper", "a.xml", nullptr}).code() == StatusCode::kUnknownName);
}

}  // namespace
}  // namespace b4mrl
