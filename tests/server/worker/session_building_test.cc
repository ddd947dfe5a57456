// When a worker builds the sessions whose Attach has come, and whom it answers.
#include <catch2/catch.hpp>
#include <string>

#include "server/worker/dispatcher.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

const std::string kOther = "another token...";

TEST_CASE("While others' requests come, a session is built some time after the one before it") {
  WorkerFixture worker;
  const Clock::time_point early = Clock::now();
  worker.Open(1);
  SECTION("not at once, since a request has come") {
    worker.Reset({1});
    worker.answers.clear();
    worker.Send(worker.AttachRequest(worker.Allocate(1, kOther)), {});
    worker.dispatcher().BuildNext(early);
    CHECK(worker.answers.empty());
    CHECK_FALSE(worker.dispatcher().idle());
    CHECK(worker.dispatcher().MsToNextTurn() < limits::kMaxDeadlineMs);
    worker.dispatcher().BuildNext(Clock::time_point::max());
  }
  SECTION("not at once, since a request is under way") {
    worker.Reset({1});
    REQUIRE(worker.Attach(worker.Allocate(1, "a third token...")) == StatusCode::kOk);
    worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Actions(1, 0.1f)}, true);
    worker.answers.clear();
    worker.Send(worker.AttachRequest(worker.Allocate(1, kOther)), {});
    worker.dispatcher().BuildNext(early);
    CHECK(worker.answers.empty());
    worker.dispatcher().BuildNext(Clock::time_point::max());
  }
  SECTION("at once, since nobody waits") {
    worker.answers.clear();
    worker.Send(worker.AttachRequest(worker.Allocate(1, kOther)), {});
    CHECK(worker.dispatcher().MsToNextTurn() == 0);
    worker.dispatcher().BuildNext(early);
  }
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kOk);
  worker.Work();
}

TEST_CASE("One session is built in a turn of the loop") {
  WorkerFixture worker;
  for (const char* token : {"first token.....", "second token....", "third token....."}) {
    worker.Send(worker.AttachRequest(worker.Allocate(1, token)), {});
  }
  CHECK(worker.answers.empty());
  for (size_t built = 1; built <= 3; ++built) {
    worker.dispatcher().BuildNext(Clock::now());
    CHECK(worker.dispatcher().session_count() == built);
  }
}

TEST_CASE("An Attach that is sent again while it waits is answered once, to the newest sender") {
  WorkerFixture worker;
  const pb::Request attach = worker.AttachRequest(worker.Allocate(1));
  worker.Send(attach, {}, false, "old connection");
  worker.Send(attach, {}, false, "new connection");
  worker.Work();
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].receiver == "new connection");
  CHECK(worker.answers[0].code() == StatusCode::kOk);
}

TEST_CASE("An Attach that waits is refused when its record is given to another session") {
  WorkerFixture worker;
  const uint32_t index = worker.Allocate(1);
  worker.Send(worker.AttachRequest(index), {}, false, "first");
  SessionTable(worker.state()).Free(index);
  SECTION("which is not attached") {}
  SECTION("which is attached meanwhile") {
    REQUIRE(worker.Allocate(1, kOther) == index);
    worker.Send(worker.AttachRequest(index), {}, false, "second");
  }
  const bool has_second = worker.answers.size() == 1;
  worker.Work();
  REQUIRE(worker.answers.size() == (has_second ? 2 : 1));
  CHECK(worker.answers[0].receiver == "first");
  CHECK(worker.answers[0].code() == StatusCode::kSessionLost);
  if (has_second) CHECK(worker.answers[1].code() == StatusCode::kOk);
}

TEST_CASE("A worker that stops refuses the Attaches that wait, and is idle") {
  WorkerFixture worker;
  const pb::Request attach = worker.AttachRequest(worker.Allocate(1));
  worker.Send(attach, {});
  worker.dispatcher().StopAccepting();
  CHECK(worker.dispatcher().idle());
  worker.Send(attach, {});
  REQUIRE(worker.answers.size() == 2);
  for (const Answer& answer : worker.answers) CHECK(answer.code() == StatusCode::kUnavailable);
  CHECK(worker.dispatcher().session_count() == 0);
}

}  // namespace
}  // namespace b4mrl
