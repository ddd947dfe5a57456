// Replies of many rows, and whom they keep waiting.
#include "server/batches/batch_turns.h"

#include <catch2/catch.hpp>
#include <string>

#include "proto/base/limits.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

constexpr int64_t kNever = 3'600'000;

// Requests for a dataset, as a worker keeps them.
struct Asked {
  StoreFixture files;
  std::shared_ptr<const Dataset> dataset = files.OpenMade("").value().dataset;
  int beats = 0;
  BatchTurns turns{[this] { ++beats; }};

  static PendingRequest Pending(const std::string& peer, uint64_t id, uint32_t rows,
                                uint32_t batches, int64_t deadline_ms = kNever) {
    PendingRequest pending;
    pending.from = {peer, id};
    pending.deadline = Deadline::AfterMs(deadline_ms);
    pending.request.mutable_sample()->set_rows(rows);
    pending.request.mutable_sample()->set_batches(batches);
    return pending;
  }
  // More than a slice on any machine: 64 MB.
  static PendingRequest Large(const std::string& peer, uint64_t id, int64_t deadline_ms = kNever) {
    return Pending(peer, id, limits::kMaxRowsPerBatch, 5, deadline_ms);
  }
  std::optional<BatchJob> Begin(PendingRequest pending) {
    auto reply = BatchReply::To(pending.request.sample(), dataset);
    REQUIRE(reply.ok());
    REQUIRE(turns.MayBegin(pending.from.peer, reply->payload_bytes()));
    return turns.Begin({std::move(pending), Clock::now(), std::move(*reply)});
  }
};

TEST_CASE("a reply of many rows is filled in slices, and others are filled between them") {
  Asked asked;
  CHECK_FALSE(asked.Begin(Asked::Large("a", 1)));
  const auto small = asked.Begin(Asked::Pending("b", 1, 5, 1));
  REQUIRE(small);
  CHECK(small->complete);
  CHECK(small->pending.from.peer == "b");
  int slices = 1;
  std::optional<BatchJob> large;
  for (; !large; ++slices) large = asked.turns.Next();
  CHECK(slices > 1);
  CHECK(large->complete);
  CHECK(asked.beats >= slices - 1);
  CHECK(asked.turns.empty());
}

TEST_CASE("replies under way go on in turns") {
  Asked asked;
  CHECK_FALSE(asked.Begin(Asked::Large("a", 1)));
  CHECK_FALSE(asked.Begin(Asked::Large("b", 1)));
  int left = 2;
  while (left == 2) left -= asked.turns.Next().has_value();
  // Had one of them been filled first, the other one would have most of its rows before it.
  int slices = 0;
  for (; left == 1; ++slices) left -= asked.turns.Next().has_value();
  CHECK(slices <= 5);
}

TEST_CASE("of one connection one reply is under way, and of large ones a few") {
  Asked asked;
  for (int i = 0; i < 8; ++i) CHECK_FALSE(asked.Begin(Asked::Large(std::to_string(i), 1)));
  const auto may_begin = [&](const std::string& peer, size_t bytes) {
    return asked.turns.MayBegin(peer, bytes);
  };
  CHECK_FALSE(may_begin("7", 1000));
  CHECK(may_begin("8", 1000));
  CHECK_FALSE(may_begin("8", limits::kMaxPayloadBytes));

  // What may not begin waits; of the rest the first comes first.
  CHECK(asked.turns.Wait(Asked::Large("8", 1), limits::kMaxPayloadBytes).ok());
  CHECK(asked.turns.Wait(Asked::Pending("7", 2, 5, 1), 1000).ok());
  CHECK_FALSE(asked.turns.TakeWaiting());
  CHECK(asked.turns.Wait(Asked::Pending("9", 1, 5, 1), 1000).ok());
  CHECK(asked.turns.TakeWaiting()->from.peer == "9");
  CHECK_FALSE(asked.turns.TakeWaiting());
  while (!asked.turns.Next()) continue;
  CHECK(asked.turns.TakeWaiting()->from.peer == "8");
}

TEST_CASE("a copy of a request that waits or is under way takes no place, but sets its deadline") {
  Asked asked;
  CHECK_FALSE(asked.Begin(Asked::Large("a", 1)));
  CHECK(asked.turns.Wait(Asked::Large("a", 2), limits::kMaxPayloadBytes).ok());
  for (int i = 0; i < 1000; ++i) {
    REQUIRE(asked.turns.Wait(Asked::Large("a", 2), limits::kMaxPayloadBytes).ok());
  }
  CHECK(asked.turns.Wait(Asked::Large("a", 2, 0), limits::kMaxPayloadBytes).ok());
  const auto late = asked.turns.TakeWaiting();
  REQUIRE(late);
  CHECK(late->from.request_id == 2);
  CHECK_FALSE(asked.turns.TakeWaiting());

  CHECK(asked.turns.Wait(Asked::Large("a", 1, 0), limits::kMaxPayloadBytes).ok());
  const auto ended = asked.turns.Next();
  REQUIRE(ended);
  CHECK(ended->pending.from.request_id == 1);
  CHECK_FALSE(ended->complete);
  CHECK(asked.turns.empty());
}

TEST_CASE("requests for rows that wait are bounded for each connection") {
  Asked asked;
  CHECK_FALSE(asked.Begin(Asked::Large("a", 0)));
  for (uint32_t id = 1; id <= limits::kMaxRequestsInFlight; ++id) {
    REQUIRE(asked.turns.Wait(Asked::Large("a", id), 0).ok());
  }
  CHECK(asked.turns.Wait(Asked::Large("a", 100), 0).code() == StatusCode::kLimitExceeded);
  CHECK(asked.turns.Wait(Asked::Large("b", 100), 0).ok());
  CHECK(asked.turns.TakeAll().size() == limits::kMaxRequestsInFlight + 2);
  CHECK(asked.turns.empty());
}

TEST_CASE("what a peer sent around a request for rows is not kept") {
  Asked asked;
  PendingRequest pending = Asked::Pending("a", 1, 5, 1);
  for (int i = 0; i < 1000; ++i) pending.request.add_arrays()->set_name("array");
  pending.request.GetReflection()->MutableUnknownFields(&pending.request)->AddVarint(1000, 1);
  CHECK(asked.turns.Wait(std::move(pending), 0).ok());
  const auto kept = asked.turns.TakeWaiting();
  REQUIRE(kept);
  CHECK(kept->request.SpaceUsedLong() < 1000);
  CHECK(kept->request.sample().rows() == 5);
}

}  // namespace
}  // namespace b4mrl
