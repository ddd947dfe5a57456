// The rules by which an environment worker answers, one message at a time.
#include "server/worker/dispatcher.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>

#include "server/shared_memory/blame.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("The same number is answered with the same bytes, whatever the action says then") {
  WorkerFixture worker;
  worker.Open(2);
  REQUIRE(worker.Reset({1, 1}).code() == StatusCode::kOk);
  const Answer first = worker.Step({2, 2}, 0.5f);
  const Answer again = worker.Step({2, 2}, -0.5f);
  REQUIRE(first.code() == StatusCode::kOk);
  REQUIRE(again.payload == first.payload);
  REQUIRE(worker.Step({1, 1}, 0).code() == StatusCode::kStale);
  REQUIRE(worker.Step({4, 3}, 0).code() == StatusCode::kGap);
  REQUIRE(worker.Step({3, 3}, -0.5f).payload != first.payload);
}

TEST_CASE("A request that names finished and unfinished lanes executes only the unfinished") {
  WorkerFixture both;
  both.Open(2);
  both.Reset({1, 1});
  const Answer together = both.Step({2, 2}, 0.5f);

  WorkerFixture apart;
  apart.Open(2);
  apart.Reset({1, 1});
  apart.Send(WorkerFixture::StepRequest(), {Numbers({2}), Lanes({1}), Actions(1, 0.5f)});
  apart.Work();
  REQUIRE(apart.Step({2, 2}, 0.5f).payload == together.payload);
  REQUIRE(apart.state().lane(1).committed() == 2);
}

TEST_CASE("A busy lane refuses other requests, and other lanes go on") {
  WorkerFixture worker;
  worker.Open(2);
  worker.Reset({1, 1});
  worker.answers.clear();
  worker.Send(WorkerFixture::StepRequest(1), {Numbers({2}), Lanes({0}), Actions(1, 0)}, true);
  worker.Send(WorkerFixture::StepRequest(2), {Numbers({2}), Lanes({0}), Actions(1, 0)}, true);
  pb::Request snapshot;
  snapshot.set_request_id(3);
  snapshot.mutable_snapshot();
  worker.Send(snapshot, {}, true);
  worker.Send(WorkerFixture::StepRequest(4), {Numbers({2}), Lanes({1}), Actions(1, 0)}, true);
  worker.Work();
  std::map<uint64_t, StatusCode> codes;
  for (const Answer& answer : worker.answers) codes[answer.envelope.request_id()] = answer.code();
  REQUIRE(codes == std::map<uint64_t, StatusCode>{{1, StatusCode::kOk},
                                                  {2, StatusCode::kBusy},
                                                  {3, StatusCode::kBusy},
                                                  {4, StatusCode::kOk}});
}

TEST_CASE("Nothing is stepped after the deadline, and the number stays free") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  pb::Request request = WorkerFixture::StepRequest();
  request.set_deadline_ms(1);
  worker.Send(request, {Numbers({2}), Actions(1, 0)}, true);
  const Deadline later = Deadline::AfterMs(2);
  while (!later.expired()) {
  }
  worker.Work();
  REQUIRE(worker.answers.at(0).code() == StatusCode::kDeadlineExceeded);
  REQUIRE(worker.state().lane(0).committed() == 1);
  REQUIRE(worker.Step({2}, 0).code() == StatusCode::kOk);
}

TEST_CASE("What a request says wrongly is refused before anything is stepped") {
  WorkerFixture worker;
  worker.Open(2);
  const StatusCode invalid = StatusCode::kInvalidArgument;
  const auto step = [&](const std::vector<Input>& inputs) {
    return worker.Call(WorkerFixture::StepRequest(), inputs).code();
  };
  REQUIRE(step({Numbers({1, 1}), Actions(2, 0)}) ==
          StatusCode::kFailedPrecondition);  // no reset yet
  worker.Reset({1, 1});
  REQUIRE(step({Actions(2, 0)}) == invalid);
  REQUIRE(step({Numbers({2, 2})}) == invalid);
  REQUIRE(step({Numbers({2, 2}), Actions(1, 0)}) == invalid);
  REQUIRE(step({Numbers({2, 2}), Actions(2, std::nanf(""))}) == invalid);
  REQUIRE(step({Numbers({2, 2}), Actions(2, INFINITY)}) == invalid);
  REQUIRE(step({Numbers({2}), Lanes({2}), Actions(1, 0)}) == invalid);
  REQUIRE(step({Numbers({2, 2}), Lanes({1, 1}), Actions(2, 0)}) == invalid);
  REQUIRE(step({Numbers({}), Lanes({}), Actions(0, 0)}) == invalid);
  REQUIRE(worker.state().lane(0).committed() == 1);
  REQUIRE(worker.state().lane(1).committed() == 1);
  pb::Request unknown = WorkerFixture::StepRequest();
  unknown.set_session_token(std::string(limits::kTokenBytes, 'x'));
  REQUIRE(worker.Call(unknown, {}).code() == StatusCode::kSessionLost);
}

TEST_CASE("Requests in flight are limited") {
  WorkerFixture worker;
  worker.Open(limits::kMaxRequestsInFlight + 1);
  worker.Reset(std::vector<uint64_t>(limits::kMaxRequestsInFlight + 1, 1));
  worker.answers.clear();
  for (uint32_t lane = 0; lane <= limits::kMaxRequestsInFlight; ++lane) {
    worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Lanes({lane}), Actions(1, 0)}, true);
  }
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
  REQUIRE(worker.answers.size() == limits::kMaxRequestsInFlight + 1);
}

TEST_CASE("Requests that wait in a worker are limited over all its sessions") {
  constexpr uint32_t kSessions = limits::kMaxQueuedRequests / limits::kMaxRequestsInFlight;
  WorkerFixture worker;
  std::vector<std::string> tokens;
  for (uint32_t i = 0; i < kSessions; ++i) {
    tokens.push_back(OpenNumbered(worker, i, limits::kMaxRequestsInFlight));
  }
  pb::Request late = WorkerFixture::StepRequest(1);
  late.set_session_token(OpenNumbered(worker, kSessions, 1));
  worker.answers.clear();
  for (const std::string& token : tokens) {
    for (uint32_t lane = 0; lane < limits::kMaxRequestsInFlight; ++lane) {
      pb::Request step = WorkerFixture::StepRequest(lane + 1);
      step.set_session_token(token);
      worker.Send(step, {Numbers({2}), Lanes({lane}), Actions(1, 0)}, true);
    }
  }
  REQUIRE(worker.answers.empty());
  worker.Send(late, {Numbers({2}), Actions(1, 0)}, true);
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
  REQUIRE(worker.answers.size() == 1 + limits::kMaxQueuedRequests);
  REQUIRE(worker.Call(late, {Numbers({2}), Actions(1, 0)}).code() == StatusCode::kOk);
}

TEST_CASE("Payloads that wait in a worker are limited by their bytes") {
  constexpr uint32_t kFitting = 3;
  WorkerFixture worker;
  worker.memory.requests = kFitting * limits::kMaxPayloadBytes + (1 << 16);  // for the replies
  worker.Restart();
  pb::Request step = WorkerFixture::StepRequest(1);
  step.set_protocol_version(limits::kProtocolVersion);
  ArrayLayout layout(step.mutable_arrays());
  const size_t numbers = layout.Add("numbers", DType::kUint64, {1});
  const size_t actions = layout.Add("actions", DType::kFloat32, {1, kActions});
  // Zeros from the system, of which one page is touched; all requests share them.
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);
  ArrayAt<uint64_t>(payload, numbers, 1)[0] = 2;
  std::ranges::fill(ArrayAt<float>(payload, actions, kActions), 0.f);
  std::vector<std::string> tokens;
  for (uint32_t i = 0; i <= kFitting; ++i) tokens.push_back(OpenNumbered(worker, i, 1));
  worker.answers.clear();
  const auto send = [&](uint32_t session) {
    step.set_session_token(tokens[session]);
    Message message{Frame::Copy(step.SerializeAsString()), payload.Share()};
    worker.dispatcher().Handle({"client", std::move(message)}, true);
  };
  for (uint32_t i = 0; i < kFitting; ++i) send(i);
  REQUIRE(worker.answers.empty());
  send(kFitting);
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
  send(kFitting);
  worker.Work();
  REQUIRE(worker.answers.size() == kFitting + 2);
  REQUIRE(worker.answers.back().code() == StatusCode::kOk);
}

TEST_CASE("Replies that are being made count with the requests") {
  constexpr uint32_t kLanes = 64;
  WorkerFixture worker;
  worker.memory.requests = 20'000;  // for one snapshot of all lanes and much less than another
  worker.Restart();
  pb::Request snapshot;
  snapshot.mutable_snapshot();
  std::vector<std::string> tokens;
  for (uint32_t i = 0; i < 2; ++i) tokens.push_back(OpenNumbered(worker, i, kLanes));
  worker.answers.clear();
  for (const std::string& token : tokens) {
    snapshot.set_session_token(token);
    worker.Send(snapshot, {}, true);
  }
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  CHECK(worker.answers[1].code() == StatusCode::kOk);
  CHECK(worker.answers[1].payload.size() > worker.memory.requests / 2);
  CHECK(worker.Call(snapshot, {}).code() == StatusCode::kOk);
}

TEST_CASE("One session's payloads leave room for those of others") {
  WorkerFixture worker;
  const std::string greedy = OpenNumbered(worker, 0, 1), modest = OpenNumbered(worker, 1, 1);
  worker.answers.clear();
  Frame payload = Frame::OfSize(limits::kMaxPayloadBytes);  // no page of it is touched
  uint64_t id = 0;
  const auto query = [&](const std::string& token) {
    pb::Request request;
    request.set_protocol_version(limits::kProtocolVersion);
    request.set_request_id(++id);
    request.set_session_token(token);
    request.mutable_query();
    ArrayLayout layout(request.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {1, 17});
    layout.Add("actions", DType::kFloat32, {1, kActions});
    Message message{Frame::Copy(request.SerializeAsString()), payload.Share()};
    worker.dispatcher().Handle({"client", std::move(message)}, true);
  };
  for (size_t i = 0; i < limits::kMaxSessionBytes / limits::kMaxPayloadBytes; ++i) query(greedy);
  REQUIRE(worker.answers.empty());
  query(greedy);
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  query(modest);
  CHECK(worker.answers.size() == 1);
  worker.Work();
  CHECK(worker.answers.size() == id);
}

TEST_CASE("Close waits for what is under way, and closing twice is closing once") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  pb::Request close;
  close.mutable_close();
  worker.Send(WorkerFixture::StepRequest(), {Numbers({2}), Actions(1, 0)}, true);
  worker.Send(close, {}, true);
  worker.Send(WorkerFixture::StepRequest(), {Numbers({3}), Actions(1, 0)}, true);
  worker.Work();
  REQUIRE(worker.answers.size() == 3);
  REQUIRE(worker.answers[0].code() == StatusCode::kSessionLost);  // came after the Close
  REQUIRE(worker.answers[1].envelope.has_step());
  REQUIRE(worker.answers[2].envelope.has_close());
  REQUIRE(worker.state().session(index).state() == SessionState::kClosed);
  REQUIRE(worker.Call(close, {}).code() == StatusCode::kOk);
}

TEST_CASE("A session that nobody uses ends when its lease does") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE(worker.dispatcher().session_count() == 1);
  worker.state().session(index).last_activity_ms -= limits::kLoopbackLeaseMs + 1;
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.Reset({1}).code() == StatusCode::kSessionLost);
}

TEST_CASE("A request renews its session's lease, and one that is under way keeps it") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  const auto age = [&] {
    worker.state().session(index).last_activity_ms -= limits::kLoopbackLeaseMs + 1;
  };
  age();
  REQUIRE(worker.Step({2}, 0).code() == StatusCode::kOk);
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE(worker.dispatcher().session_count() == 1);
  worker.Send(WorkerFixture::StepRequest(), {Numbers({3}), Actions(1, 0)}, true);
  age();
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE(worker.dispatcher().session_count() == 1);
  worker.Work();
  REQUIRE(worker.answers.back().code() == StatusCode::kOk);
}

// The record of a session that the worker has built and the gateway has not acknowledged yet.
uint32_t OpenUnacknowledged(WorkerFixture& worker, const std::string& token) {
  const uint32_t index = worker.Open(2, token);
  worker.state().session(index).granted.store(SessionState::kOpening);
  return index;
}

TEST_CASE("A session is served only once the gateway has acknowledged it") {
  WorkerFixture worker;
  const uint32_t index = OpenUnacknowledged(worker, kToken);
  REQUIRE(worker.Reset({1, 1}).code() == StatusCode::kSessionLost);
  SessionTable(worker.state()).MakeLive(index);
  REQUIRE(worker.Reset({1, 1}).code() == StatusCode::kOk);
}

TEST_CASE("A session whose record was given to another one reaches nothing of that one") {
  WorkerFixture worker;
  const uint32_t index = OpenUnacknowledged(worker, kToken);
  SessionTable(worker.state()).Free(index);
  const std::string other = "another token...";
  REQUIRE(worker.Open(2, other) == index);
  const auto call = [&worker](const std::string& token, pb::Request request,
                              const std::vector<Input>& inputs) {
    request.set_session_token(token);
    return worker.Call(request, inputs).code();
  };
  pb::Request reset, close;
  reset.mutable_reset();
  close.mutable_close();
  REQUIRE(call(other, reset, {Numbers({1, 1})}) == StatusCode::kOk);
  REQUIRE(call(kToken, reset, {Numbers({2, 2})}) == StatusCode::kSessionLost);
  REQUIRE(worker.state().lane(0).committed() == 1);
  REQUIRE(call(kToken, close, {}) == StatusCode::kOk);
  REQUIRE(worker.state().session(index).state() == SessionState::kLive);
  REQUIRE(call(other, reset, {Numbers({2, 2})}) == StatusCode::kOk);
}

TEST_CASE("An Attach that names an earlier session of the record is refused") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  pb::Request attach;
  attach.mutable_attach()->set_session_index(index);
  attach.mutable_attach()->set_generation(worker.state().session(index).generation - 1);
  REQUIRE(worker.Call(attach, {}).code() == StatusCode::kSessionLost);
}

TEST_CASE("A session without its record is forgotten when leases are looked at") {
  WorkerFixture worker;
  const uint32_t index = OpenUnacknowledged(worker, kToken);
  SessionTable(worker.state()).Free(index);
  worker.dispatcher().ReapIdleSessions(MonotonicMs());
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.state().session(index).state() == SessionState::kFree);
}

TEST_CASE("A reset that ended its worker twice is refused, and another seed is not") {
  WorkerFixture worker;
  worker.Open(1);
  for (int death = 0; death < 2; ++death) {
    worker.state().lane(0).AddBlame(1, AttemptKey(Operation::kReset, 7), kCrashBlame);
  }
  pb::Request reset;
  reset.mutable_reset();
  const auto seed = [](uint64_t value) { return Array<uint64_t>("seeds", {1}, {value}); };
  const Answer refused = worker.Call(reset, {Numbers({1}), seed(7)});
  REQUIRE(refused.code() == StatusCode::kFailedPrecondition);
  REQUIRE(refused.envelope.status().message().find("another seed") != std::string::npos);
  REQUIRE(worker.Call(reset, {Numbers({1}), seed(8)}).code() == StatusCode::kOk);
}

TEST_CASE("A restore that ended its worker twice is refused, and a reset is not") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  pb::Request restore;
  restore.mutable_restore();
  const std::vector<double> zeros(9, 0);
  const Input qpos = Array<double>("qpos", {1, 9}, zeros);
  const Input qvel = Array<double>("qvel", {1, 9}, zeros);
  for (int death = 0; death < 2; ++death) {
    worker.state().lane(0).AddBlame(2, AttemptKey(Operation::kRestore), kCrashBlame);
  }
  const Answer refused = worker.Call(restore, {Numbers({2}), qpos, qvel});
  REQUIRE(refused.code() == StatusCode::kFailedPrecondition);
  REQUIRE(refused.envelope.status().message().find("allowed: a reset") != std::string::npos);
  REQUIRE(worker.Reset({2}).code() == StatusCode::kOk);
  REQUIRE(worker.Call(restore, {Numbers({3}), qpos, qvel}).code() == StatusCode::kOk);
}

TEST_CASE("A step that ended its worker four times, with what was done instead, is given up") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  const auto blame = [&worker] {
    worker.state().lane(0).AddBlame(2, AttemptKey(Operation::kStep), kCrashBlame);
  };
  for (int death = 0; death < 4; ++death) blame();
  REQUIRE(worker.Step({2}, 0).code() == StatusCode::kInternal);
}

}  // namespace
}  // namespace b4mrl
