// Which requests of an id that is under way are copies of it, and which are refused.
#include <catch2/catch.hpp>

#include "server/worker/dispatcher.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("A request resent while it waits is executed once and answered to the newest sender") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  const std::vector<Input> inputs = {Numbers({2}), Actions(1, 0.1f)};
  worker.Send(WorkerFixture::StepRequest(7), inputs, true, "old connection");
  worker.Send(WorkerFixture::StepRequest(7), inputs, true, "new connection");
  worker.Work();
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].receiver == "new connection");
  REQUIRE(worker.state().lane(0).committed() == 2);
}

TEST_CASE("A copy of what is under way is answered though a Close waits for it") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  const std::vector<Input> inputs = {Numbers({2}), Actions(1, 0.1f)};
  pb::Request close;
  close.mutable_close();
  worker.Send(WorkerFixture::StepRequest(7), inputs, true, "old connection");
  worker.Send(close, {});
  worker.Send(WorkerFixture::StepRequest(7), inputs, true, "new connection");
  REQUIRE(worker.answers.empty());
  // An Open of the same contents gets no session that is about to end.
  worker.Send(worker.AttachRequest(index), {});
  worker.Work();
  REQUIRE(worker.answers.size() == 3);
  REQUIRE(worker.answers[0].code() == StatusCode::kBusy);
  REQUIRE(worker.answers[1].receiver == "new connection");
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
  REQUIRE(worker.answers[2].code() == StatusCode::kOk);  // the Close
}

TEST_CASE("A request id under way with other contents is refused") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  worker.Send(WorkerFixture::StepRequest(7), {Numbers({2}), Actions(1, 0.1f)}, true);
  worker.Send(WorkerFixture::StepRequest(7), {Numbers({2}), Actions(1, 0.2f)}, true);
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kInvalidArgument);
  worker.Work();
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
}

TEST_CASE("A query that differs by a number beside its arrays is no copy") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  const auto send_query = [&](uint64_t draw, uint32_t deadline_ms) {
    pb::Request request;
    request.set_request_id(7);
    request.set_deadline_ms(deadline_ms);
    request.mutable_query()->set_draw(draw);
    const Input observation = Array<float>("observations", {1, 17}, std::vector<float>(17));
    worker.Send(request, {observation, Actions(1, 0)}, true);
  };
  send_query(1, 10'000);
  send_query(1, 9'000);  // a copy has less time left
  REQUIRE(worker.answers.empty());
  send_query(2, 10'000);
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kInvalidArgument);
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
}

TEST_CASE("A Restore that gives its arrays other names is no copy, though their bytes are equal") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  pb::Request restore;
  restore.set_request_id(7);
  restore.mutable_restore();
  const std::vector<double> low(9, 0), high(9, 0.25);
  const auto send = [&](const char* first, const char* second) {
    worker.Send(
        restore,
        {Numbers({2}), Array<double>(first, {1, 9}, low), Array<double>(second, {1, 9}, high)},
        true);
  };
  send("qpos", "qvel");
  send("qpos", "qvel");
  REQUIRE(worker.answers.empty());
  send("qvel", "qpos");
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kInvalidArgument);
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
}

}  // namespace
}  // namespace b4mrl
