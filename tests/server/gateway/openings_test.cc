// Which Opens wait for what, and how each of them is answered once.
#include "server/gateway/openings.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>

#include "tests/server/gateway/openings_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("However many Opens of a token wait, its worker is asked once and all are answered") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  for (uint64_t id = 1; id <= 100; ++id) fixture.Ask("client", Open(id, Token(1)));
  fixture.Ask("other", Open(7, Token(1)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  for (uint64_t id = 1; id <= 100; ++id) CHECK(fixture.AnswerTo("client", id) == StatusCode::kOk);
  CHECK(fixture.AnswerTo("other", 7) == StatusCode::kOk);
  CHECK_FALSE(fixture.worker->Take(50).has_value());
}

TEST_CASE("A session for which a worker lacks memory goes to the next, until all have refused it") {
  OpeningsFixture fixture(/*worker_count=*/2);
  std::unique_ptr<FakeServer> first = fixture.WorkerOf(0), second = fixture.WorkerOf(1);
  fixture.worker = std::move(first);
  fixture.Ask("client", Open(1, Token(1)));
  const FakeCall refused = fixture.TakeAttach();
  fixture.Refuse(refused);
  fixture.Refuse(refused);  // a copy of the answer says nothing of the other worker
  std::swap(fixture.worker, second);
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);

  std::swap(fixture.worker, second);  // which has no session yet, and is asked first
  fixture.Ask("client", Open(2, Token(2)));
  fixture.Refuse(fixture.TakeAttach());
  std::swap(fixture.worker, second);
  fixture.Refuse(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kLimitExceeded);
}

TEST_CASE("A session that a worker refuses for memory goes to no worker that is down") {
  OpeningsFixture fixture(/*worker_count=*/3);
  fixture.state().child(kFirstWorkerChild + 1).process_id = 0;
  std::unique_ptr<FakeServer> first = fixture.WorkerOf(0), third = fixture.WorkerOf(2);
  fixture.worker = std::move(first);
  fixture.Ask("client", Open(1, Token(1)));
  fixture.Refuse(fixture.TakeAttach());
  std::swap(fixture.worker, third);
  fixture.Refuse(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kLimitExceeded);
}

TEST_CASE("A copy of an Open joins it, and another Open of its id is refused") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  for (int i = 0; i < 3; ++i) fixture.Ask("client", Open(1, Token(1)));
  pb::Request other = Open(1, Token(1));
  other.mutable_open()->set_seed(other.open().seed() + 1);
  for (const pb::Request& request : {Open(1, Token(2)), other}) {
    fixture.Ask("client", request);
    CHECK(fixture.AnswerTo("client", 1) == StatusCode::kInvalidArgument);
    fixture.answers.clear();
  }
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("Opens that wait are bounded, of a connection and of all") {
  OpeningsFixture fixture;  // without a worker
  constexpr uint64_t kOfPeer = limits::kMaxPendingOpensOfPeer;
  constexpr uint64_t kPeers = limits::kMaxPendingOpens / kOfPeer;
  for (uint64_t peer = 0; peer < kPeers; ++peer) {
    for (uint64_t id = 0; id < kOfPeer; ++id) {
      fixture.Ask("peer" + std::to_string(peer), Open(id, Token(1)));
    }
    REQUIRE(fixture.answers.empty());
    if (peer > 0) continue;
    fixture.Ask("peer0", Open(kOfPeer, Token(1)));
    REQUIRE(fixture.AnswerTo("peer0", kOfPeer) == StatusCode::kLimitExceeded);
    fixture.answers.clear();
  }
  fixture.Ask("late", Open(1, Token(1)));
  CHECK(fixture.AnswerTo("late", 1) == StatusCode::kLimitExceeded);
  // All of them are answered in the end.
  fixture.StartWorker();
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.answers.size() == limits::kMaxPendingOpens + 1);
  fixture.Ask("late", Open(2, Token(1)));
  CHECK_FALSE(fixture.openings->empty());
}

TEST_CASE("What does not fit into a worker's queue reaches it later") {
  OpeningsFixture fixture;
  constexpr uint64_t kSessions = limits::kMaxSessions;
  static_assert(kSessions > limits::kHighWaterMark);
  for (uint64_t i = 0; i < kSessions; ++i) {
    fixture.Ask("peer" + std::to_string(i / 100), Open(i, Token(i)));
  }
  fixture.openings->Pump();
  fixture.StartWorker();
  for (uint64_t i = 0; i < kSessions; ++i) fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  REQUIRE(fixture.answers.size() == kSessions);
  for (const auto& [asker, answers] : fixture.answers) {
    REQUIRE(answers.size() == 1);
    REQUIRE(answers[0].ok());
  }
}

TEST_CASE("An Open whose worker is silent is answered at its deadline") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1), 60'000));
  fixture.Ask("client", Open(2, Token(1), 50));
  CHECK(fixture.openings->wait_ms(100) <= 50);
  const Deadline deadline = Deadline::AfterMs(OpeningsFixture::kPatienceMs);
  while (fixture.answers.empty() && !deadline.expired()) fixture.PumpOnce();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kDeadlineExceeded);
  CHECK(fixture.openings->wait_ms(100) == 100);  // the loop need not turn for the other
  const FakeCall attach = fixture.TakeAttach();
  fixture.Attached(attach);
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("A worker is not asked again for what it has not answered yet") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1), 1));
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kDeadlineExceeded);
  fixture.Ask("client", Open(2, Token(1)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kOk);
  CHECK_FALSE(fixture.worker->Take(50).has_value());
}

TEST_CASE(
    "A worker is asked again by a copy of the Open, since its answer may have found no room") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1)));
  fixture.TakeAttach();
  fixture.Ask("client", Open(1, Token(1)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("A replaced worker is asked again, however often it is replaced") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1)));
  for (int i = 0; i < 4; ++i) {
    fixture.TakeAttach();
    fixture.StartWorker();
  }
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("When the daemon stops, the Opens that wait for workers and models are refused at once") {
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.Ask("a", Open(1, Token(1)));
  fixture.AskForModel("a", 2, "slow.xml");
  const FakeCall attach = fixture.TakeAttach();
  fixture.openings->RefuseAll();
  CHECK(fixture.openings->empty());
  fixture.Attached(attach);  // an answer that comes later says nothing to anybody
  fixture.Ask("a", Open(3, Token(3)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("a", 1) == StatusCode::kUnavailable);
  CHECK(fixture.AnswerTo("a", 2) == StatusCode::kUnavailable);
  CHECK(fixture.AnswerTo("a", 3) == StatusCode::kOk);
}

}  // namespace
}  // namespace b4mrl
