#include "client/remote_environment.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "client/client.h"
#include "proto/base/limits.h"
#include "tests/client/fake_session.h"

namespace b4mrl {
namespace {

std::vector<float> FirstColumn(const StepOutcome& outcome) {
  std::vector<float> column;
  for (size_t i = 0; i < outcome.observations.rows(); ++i) {
    column.push_back(outcome.observations.As<float>()[i * kObservationSize]);
  }
  return column;
}

TEST_CASE("resets and steps carry the next number of each lane") {
  FakeDaemon daemon;
  FakeSession session(daemon);
  Result<StepOutcome> outcome = session->Reset();
  REQUIRE(outcome.ok());
  CHECK(FirstColumn(*outcome) == std::vector<float>{1, 1});
  CHECK(outcome->rewards.empty());
  const std::vector<uint32_t> second_lane = {1};
  outcome = session->Step(kOneAction, second_lane);
  REQUIRE(outcome.ok());
  CHECK(FirstColumn(*outcome) == std::vector<float>{2});
  outcome = session->Step(kTwoActions);
  REQUIRE(outcome.ok());
  CHECK(FirstColumn(*outcome) == std::vector<float>{2, 3});
  CHECK(outcome->rewards[1] == 1.5);
}

TEST_CASE("actions travel in the type that the caller has") {
  std::vector<pb::DType> types;
  FakeDaemon daemon([&types](FakeServer&, FakeCall& call) {
    if (call.request.has_step()) types.push_back(call.request.arrays(1).dtype());
    return false;
  });
  FakeSession session(daemon);
  REQUIRE(session->Step(kTwoActions).ok());
  REQUIRE(session->Step(std::vector<double>(2 * kActionSize, 0.1)).ok());
  CHECK(types == std::vector<pb::DType>{pb::FLOAT32, pb::FLOAT64});
}

TEST_CASE("requests for different lanes are in flight together and received as they are answered") {
  // Holds the first step back until the second one has been refused, then refuses it too.
  std::optional<FakeCall> held;
  bool refused = false;
  FakeDaemon daemon([&](FakeServer& server, FakeCall& call) {
    if (!call.request.has_step()) return false;
    if (!held) {
      held = std::move(call);
      return true;
    }
    if (refused) return false;
    refused = true;
    server.ReplyError(call, InvalidArgument("actions", "NaN", "finite numbers"));
    server.ReplyError(*held, InvalidArgument("actions", "infinity", "finite numbers"));
    return true;
  });
  FakeSession session(daemon);
  const std::vector<uint32_t> lane0 = {0};
  const std::vector<uint32_t> lane1 = {1};
  const Result<uint64_t> first = session->Send(kOneAction, lane0);
  const Result<uint64_t> second = session->Send(kOneAction, lane1);
  REQUIRE((first.ok() && second.ok()));
  CHECK(session->in_flight() == 2);
  CHECK(session->Send(kOneAction, lane1).status().code() == StatusCode::kBusy);
  uint64_t failed = 0;
  CHECK(session->Receive(&failed).status().code() == StatusCode::kInvalidArgument);
  CHECK(failed == *second);
  CHECK(session->Receive(&failed).status().code() == StatusCode::kInvalidArgument);
  CHECK(failed == *first);
  CHECK(session->in_flight() == 0);
  // Both refusals left the numbers as they were.
  const Result<StepOutcome> outcome = session->Step(kTwoActions);
  REQUIRE(outcome.ok());
  CHECK(FirstColumn(*outcome) == std::vector<float>{1, 1});
}

TEST_CASE("a step without an answer loses its lanes and no others") {
  std::atomic<bool> silent{true};
  FakeDaemon daemon(
      [&silent](FakeServer&, FakeCall& call) { return silent && call.request.has_step(); });
  FakeSession session(daemon, {.num_envs = 2, .deadline_ms = 1'000});
  const std::vector<uint32_t> lane0 = {0};
  const std::vector<uint32_t> lane1 = {1};
  CHECK(session->Step(kOneAction, lane0).status().code() == StatusCode::kDeadlineExceeded);
  silent = false;
  CHECK(session->Step(kOneAction, lane0).status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Step(kOneAction, lane1).ok());
}

TEST_CASE("a reply must have one row for each lane of its request") {
  // Answers as if so many lanes had been named, with all else as it should be.
  std::atomic<size_t> rows{0};
  FakeDaemon daemon([&rows](FakeServer& server, FakeCall& call) {
    if (!call.request.has_step() && !call.request.has_reset()) return false;
    pb::Reply reply;
    ArrayLayout layout(reply.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {rows, kObservationSize});
    layout.Add("rewards", DType::kFloat64, {rows});
    for (const char* flag : {"terminated", "truncated", "cause"}) {
      layout.Add(flag, DType::kUint8, {rows});
    }
    server.Reply(call, std::move(reply), layout.Allocate());
    return true;
  });
  for (const size_t answered : {0, 1, 3}) {
    rows = answered;
    CHECK(FakeSession(daemon)->Reset().status().code() == StatusCode::kInternal);
    CHECK(FakeSession(daemon)->Step(kTwoActions).status().code() == StatusCode::kInternal);
    FakeSession session(daemon);
    REQUIRE(session->Send(kTwoActions).ok());
    CHECK(session->Receive().status().code() == StatusCode::kInternal);
  }
  FakeSession session(daemon);
  const std::vector<uint32_t> lane0 = {0};
  const std::vector<uint32_t> lane1 = {1};
  rows = 1;
  CHECK(session->Step(kOneAction, lane1).ok());
  REQUIRE(session->Send(kOneAction, lane1).ok());
  CHECK(session->Receive().ok());
  rows = 2;
  CHECK(session->Step(kTwoActions).ok());
  // The daemon has executed what it answers, so the lane's next number is not known any more.
  const Status status = session->Step(kOneAction, lane1).status();
  CHECK(status.code() == StatusCode::kInternal);
  CHECK(status.message().starts_with("unreadable reply: "));
  rows = 1;
  CHECK(session->Step(kOneAction, lane1).status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Step(kOneAction, lane0).ok());
}

TEST_CASE("a step of which one copy was refused has no outcome, whatever the refusal says") {
  std::atomic<int> steps{0};
  FakeDaemon daemon([&steps](FakeServer& server, FakeCall& call) {
    if (!call.request.has_step()) return false;
    if (++steps == 2) server.ReplyError(call, Status(StatusCode::kBusy, "still at the first copy"));
    return true;
  });
  FakeSession session(daemon, {.num_envs = 2, .deadline_ms = 4'000});
  const std::vector<uint32_t> lane0 = {0};
  const Status status = session->Step(kOneAction, lane0).status();
  CHECK(status.code() == StatusCode::kUnavailable);
  CHECK(status.message().find("still at the first copy") != std::string::npos);
  CHECK(session->Step(kOneAction, lane0).status().code() == StatusCode::kFailedPrecondition);
}

TEST_CASE("buffers and lists of the wrong length are refused before anything is sent") {
  int requests = 0;
  FakeDaemon daemon([&requests](FakeServer&, FakeCall& call) {
    requests += call.request.has_step() || call.request.has_reset() || call.request.has_query() ||
                call.request.has_restore();
    return false;
  });
  {
    FakeSession session(daemon);
    const std::vector<uint32_t> no_such_lane = {2};
    const std::vector<uint64_t> one_seed = {7};
    CHECK(session->Step(kOneAction).status().code() == StatusCode::kInvalidArgument);
    CHECK(session->Step(kOneAction, no_such_lane).status().code() == StatusCode::kInvalidArgument);
    CHECK(session->Reset({}, one_seed).status().code() == StatusCode::kInvalidArgument);
    LaneStates states;
    states.lanes = 1;
    CHECK(session->Restore(states).status().code() == StatusCode::kInvalidArgument);
    states.lanes = 2;
    states.snapshot.resize(5);
    CHECK(session->Restore(states).status().code() == StatusCode::kInvalidArgument);
    std::vector<float> next(3);
    std::vector<double> rewards(2);
    std::vector<uint8_t> flags(2);
    CHECK(session->Query(kTwoActions, kTwoActions, {next, rewards, flags, flags}).code() ==
          StatusCode::kInvalidArgument);
  }
  CHECK(requests == 0);
}

TEST_CASE("an observation type that was not set is float32") {
  FakeDaemon daemon;
  FakeSession session(daemon, {.num_envs = 1, .observation_dtype = DType::kUnspecified});
  const Result<StepOutcome> outcome = session->Reset();
  REQUIRE(outcome.ok());
  CHECK(FirstColumn(*outcome) == std::vector<float>{1});
}

TEST_CASE("a session without lanes refuses to step, restore and snapshot") {
  FakeDaemon daemon;
  FakeSession session(daemon, {.num_envs = 0});
  CHECK(session->Reset().status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Step(std::span<const float>()).status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Snapshot().status().code() == StatusCode::kFailedPrecondition);
  CHECK(session->Restore({}).status().code() == StatusCode::kFailedPrecondition);
}

TEST_CASE("each session is closed once, however it is moved") {
  FakeDaemon daemon;
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  {
    Result<RemoteEnvironment> first = client->Make("Fake");
    Result<RemoteEnvironment> second = client->Make("Fake");
    REQUIRE((first.ok() && second.ok()));
    RemoteEnvironment moved = std::move(*first);
    CHECK(daemon.closed_sessions() == 0);
    moved = std::move(*second);
    CHECK(daemon.closed_sessions() == 1);
  }
  CHECK(daemon.closed_sessions() == 2);
}

TEST_CASE("a session with as many requests in flight as may be is given back") {
  FakeDaemon daemon([](FakeServer&, FakeCall& call) { return call.request.has_step(); });
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const uint32_t lanes = limits::kMaxRequestsInFlight;
  const auto fill = [lanes](RemoteEnvironment& environment) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
      REQUIRE(environment.Send(kOneAction, std::span(&lane, 1)).ok());
    }
  };
  Result<RemoteEnvironment> closed = client->Make("Fake", {.num_envs = lanes});
  REQUIRE(closed.ok());
  fill(*closed);
  CHECK(closed->Close().ok());
  CHECK(daemon.closed_sessions() == 1);
  {
    Result<RemoteEnvironment> forgotten = client->Make("Fake", {.num_envs = lanes});
    REQUIRE(forgotten.ok());
    fill(*forgotten);
  }
  CHECK(daemon.closed_sessions() == 2);
}

TEST_CASE("a session whose opening failed half way is given back") {
  SECTION("no answer in time") {
    FakeDaemon daemon([](FakeServer&, FakeCall& call) { return call.request.has_open(); });
    Result<Client> client = Client::Connect(daemon.address());
    REQUIRE(client.ok());
    CHECK(client->Make("Fake", {.deadline_ms = 1'000}).status().code() ==
          StatusCode::kDeadlineExceeded);
    CHECK(daemon.closed_sessions() == 1);
  }
  SECTION("an answer that does not fit") {
    FakeDaemon daemon;
    daemon.open_reply.set_observation_dtype(pb::UINT8);
    Result<Client> client = Client::Connect(daemon.address());
    REQUIRE(client.ok());
    CHECK_FALSE(client->Make("Fake").ok());
    CHECK(daemon.closed_sessions() == 1);
  }
}

TEST_CASE("a server of another protocol is refused with both versions") {
  FakeDaemon daemon;
  daemon.protocol_version = 9;
  const Status status = Client::Connect(daemon.address()).status();
  CHECK(status.code() == StatusCode::kVersionMismatch);
  CHECK(status.message().find("protocol 9") != std::string::npos);
  CHECK(status.message().find(std::to_string(limits::kProtocolVersion)) != std::string::npos);
}

TEST_CASE("a reply that does not fit what was opened is refused") {
  FakeDaemon daemon;
  daemon.open_reply.set_num_envs(4'000'000'000u);
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  CHECK(client->Make("Fake").status().code() == StatusCode::kInternal);
}

}  // namespace
}  // namespace b4mrl
