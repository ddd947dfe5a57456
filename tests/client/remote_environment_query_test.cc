// Queries of a session.
#include <catch2/catch.hpp>
#include <span>
#include <string>
#include <vector>

#include "client/client.h"
#include "client/remote_environment.h"
#include "proto/base/limits.h"
#include "tests/client/fake_session.h"
#include "tests/resource_limit.h"

namespace b4mrl {
namespace {

constexpr size_t kRowsAtOnce = 1024;  // of a request of a Query call

TEST_CASE("results of a query can still be received after buffers of another size were given") {
  FakeDaemon daemon;
  FakeSession session(daemon, {.num_envs = 0});
  const std::vector<float> observations(2 * kObservationSize), actions(2 * kActionSize);
  const Result<uint64_t> id = session->SendQuery(observations, actions, 0, 0, 0);
  REQUIRE(id.ok());
  std::vector<float> next(observations.size());
  std::vector<double> rewards(2);
  std::vector<uint8_t> terminated(2), valid(2);
  const Status refused = session->ReceiveQuery(
      *id, {std::span(next).first(kObservationSize), std::span(rewards).first(1),
            std::span(terminated).first(1), std::span(valid).first(1)});
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK(session->ReceiveQuery(*id, {next, rewards, terminated, valid}).ok());
}

TEST_CASE("the reply to a step is not received as that to a query") {
  FakeDaemon daemon;
  FakeSession session(daemon);
  const Result<uint64_t> id = session->Send(kTwoActions);
  REQUIRE(id.ok());
  std::vector<float> next(kObservationSize);
  std::vector<double> rewards(1);
  std::vector<uint8_t> terminated(1), valid(1);
  const QueryOutput output{next, rewards, terminated, valid};
  CHECK(session->ReceiveQuery(*id, output).code() == StatusCode::kInvalidArgument);
  CHECK(session->Receive().ok());
}

TEST_CASE("a query is cut into requests whose answers land in their places") {
  std::vector<uint64_t> first_rows;
  FakeDaemon daemon([&first_rows](FakeServer&, FakeCall& call) {
    if (call.request.has_query()) first_rows.push_back(call.request.query().first_row());
    return false;
  });
  FakeSession session(daemon, {.num_envs = 0});
  constexpr size_t kRows = 10 * kRowsAtOnce + 7;
  std::vector<float> observations(kRows * kObservationSize);
  for (size_t i = 0; i < observations.size(); ++i) observations[i] = static_cast<float>(i);
  const std::vector<float> actions(kRows * kActionSize);
  std::vector<float> next(observations.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> terminated(kRows, 9);
  std::vector<uint8_t> valid(kRows);
  const Status status =
      session->Query(observations, actions, {next, rewards, terminated, valid}, 1, 2, 1000);
  INFO(status.ToString());
  REQUIRE(status.ok());
  CHECK(first_rows.size() == 11);
  bool right = true;
  for (size_t row = 0; row < kRows; ++row) {
    right = right && rewards[row] == static_cast<double>(1000 + row) && valid[row] == 1 &&
            terminated[row] == 0 &&
            next[row * kObservationSize] == observations[row * kObservationSize] + 1;
  }
  CHECK(right);
}

TEST_CASE("queries without a draw count through the draws") {
  std::vector<uint64_t> draws;
  FakeDaemon daemon([&draws](FakeServer&, FakeCall& call) {
    if (call.request.has_query()) draws.push_back(call.request.query().draw());
    return false;
  });
  FakeSession session(daemon, {.num_envs = 0});
  constexpr size_t kRows = kRowsAtOnce + 1;  // two requests of one draw
  const std::vector<float> observations(kRows * kObservationSize), actions(kRows * kActionSize);
  std::vector<float> next(observations.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> flags(2 * kRows);
  const std::span<uint8_t> all(flags);
  const QueryOutput output{next, rewards, all.first(kRows), all.last(kRows)};
  REQUIRE(session->Query(observations, actions, output).ok());
  REQUIRE(session->Query(observations, actions, output, 1).ok());
  REQUIRE(session->Query(observations, actions, output, 1, 0).ok());
  REQUIRE(session->Query(observations, actions, output).ok());
  CHECK(draws == std::vector<uint64_t>{0, 0, 1, 1, 0, 0, 2, 2});
}

TEST_CASE("a refused query ends the call and leaves nothing in flight") {
  FakeDaemon daemon([](FakeServer& server, FakeCall& call) {
    if (call.request.query().first_row() != kRowsAtOnce) return false;
    server.ReplyError(call, Status(StatusCode::kUnsupported, "action-delay has a memory"));
    return true;
  });
  FakeSession session(daemon, {.num_envs = 0});
  constexpr size_t kRows = 3 * kRowsAtOnce;
  const std::vector<float> observations(kRows * kObservationSize);
  const std::vector<float> actions(kRows * kActionSize);
  std::vector<float> next(observations.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> flags(2 * kRows);
  const std::span<uint8_t> all(flags);
  const QueryOutput output{next, rewards, all.first(kRows), all.last(kRows)};
  for (int i = 0; i < 20; ++i) {  // leftovers would reach the bound of requests in flight
    CHECK(session->Query(observations, actions, output).code() == StatusCode::kUnsupported);
  }
}

// The sanitizers' shadow memory takes more than any limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_CASE("a query that no server takes is refused before there is memory for it") {
  FakeDaemon daemon;
  FakeSession session(daemon);
  const size_t rows = limits::kMaxPayloadBytes / (kObservationSize + kActionSize) / sizeof(float);
  const std::vector<float> observations(rows * kObservationSize), actions(rows * kActionSize);
  const ResourceLimit left(RLIMIT_AS, AddressesInUse() + (32 << 20));
  const Status refused = session->SendQuery(observations, actions, 0, 0, 0).status();
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK(refused.message().starts_with("bytes of the arrays is "));
}
#endif

}  // namespace
}  // namespace b4mrl
