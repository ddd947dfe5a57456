// Replies of many rows, and whom they keep waiting.
#include "server/batches/batch_turns.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/limits.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

constexpr int64_t kNever = 3'600'000;
constexpr uint32_t kPlacesForLarge = 8;

// Requests for a dataset, as a worker has them, and what became of them: "a1" is the request 1 of
// the connection a.
struct Asked {
  explicit Asked(size_t given = limits::kMaxFilledBytes) : bytes(given) {}

  size_t bytes;
  StoreFixture files;
  std::shared_ptr<const Dataset> dataset = files.OpenMade("").value().dataset;
  int beats = 0;
  std::vector<std::string> answered;
  std::vector<std::pair<std::string, StatusCode>> refused;
  BatchTurns turns{{.alive = [this] { ++beats; },
                    .answer =
                        [this](BatchJob job) {
                          CHECK(job.reply.payload.size() == job.reply.payload_bytes());
                          answered.push_back(NameOf(job.pending.from));
                        },
                    .refuse =
                        [this](const Asker& from, const Status& status) {
                          refused.emplace_back(NameOf(from), status.code());
                        }},
                   bytes};

  static std::string NameOf(const Asker& from) {
    return from.peer + std::to_string(from.request_id);
  }
  void Add(const std::string& peer, uint64_t id, uint32_t rows, uint32_t batches,
           int64_t deadline_ms = kNever) {
    PendingRequest pending;
    pending.from = {peer, id};
    pending.deadline = Deadline::AfterMs(deadline_ms);
    pending.request.mutable_sample()->set_rows(rows);
    pending.request.mutable_sample()->set_batches(batches);
    AddPending(std::move(pending));
  }
  void AddPending(PendingRequest pending) {
    auto reply = BatchReply::To(pending.request.sample(), dataset);
    REQUIRE(reply.ok());
    turns.Add({std::move(pending), *std::move(reply)});
  }
  void AddSmall(const std::string& peer, uint64_t id) { Add(peer, id, 5, 1); }
  // 54 MB, which take many slices on any machine.
  void AddLarge(const std::string& peer, uint64_t id, int64_t deadline_ms = kNever) {
    Add(peer, id, limits::kMaxRowsPerBatch, 5, deadline_ms);
  }
  // Turns until so many requests are answered in all; the number of turns.
  int TurnUntil(size_t answers) {
    int count = 0;
    for (; answered.size() < answers; ++count) turns.Turn();
    return count;
  }
};

using Names = std::vector<std::string>;

TEST_CASE("a reply of many rows is filled in slices, and others are filled between them") {
  Asked asked;
  asked.AddLarge("a", 1);
  asked.AddSmall("b", 1);
  asked.AddSmall("b", 2);
  CHECK(asked.answered == Names{"b1", "b2"});
  const int beats = asked.beats;
  CHECK(asked.TurnUntil(3) > 1);
  CHECK(asked.answered.back() == "a1");
  CHECK(asked.beats > beats);
  CHECK(asked.turns.empty());
}

TEST_CASE("replies under way go on in turns") {
  Asked asked;
  asked.AddLarge("a", 1);
  asked.AddLarge("b", 1);
  const int first = asked.TurnUntil(1);
  // Had the first one been filled alone, the other one would take as many turns again.
  CHECK(asked.TurnUntil(2) < first / 2);
}

TEST_CASE(
    "of one connection one reply is under way, and the next one is behind other connections") {
  Asked asked;
  for (uint64_t id = 1; id <= 3; ++id) asked.AddLarge("a", id);
  asked.AddSmall("a", 4);
  CHECK(asked.answered.empty());
  for (uint32_t i = 1; i < kPlacesForLarge; ++i) asked.AddLarge(std::string(1, 'a' + i), 1);
  asked.AddLarge("z", 1);  // waits for a place
  asked.AddSmall("y", 1);
  CHECK(asked.answered == Names{"y1"});
  asked.TurnUntil(4 + kPlacesForLarge + 1);
  const auto place = [&](const std::string& name) {
    return std::ranges::find(asked.answered, name) - asked.answered.begin();
  };
  CHECK(place("a1") < place("a2"));
  CHECK(place("z1") < place("a3"));
  CHECK(place("a2") < place("a3"));
  CHECK(asked.answered.back() == "a4");
  CHECK(asked.turns.empty());
}

TEST_CASE("however many requests one connection has waiting, another's begins after its next one") {
  Asked asked;
  for (uint32_t i = 0; i < kPlacesForLarge; ++i) {
    for (uint64_t id = 1; id <= 20; ++id) asked.AddLarge(std::string(1, 'a' + i), id);
  }
  asked.AddLarge("z", 1);
  // It begins when the first one is answered, before the second one of any other connection.
  while (asked.answered.empty() || asked.answered.back() != "z1") asked.turns.Turn();
  CHECK(asked.answered.size() <= 3 * kPlacesForLarge);
}

TEST_CASE("a copy of a request that waits or is under way takes no place, but sets its deadline") {
  Asked asked;
  asked.AddLarge("a", 1);
  for (int i = 0; i < 1000; ++i) asked.AddLarge("a", 2);
  asked.AddLarge("a", 3);
  CHECK(asked.refused.empty());
  asked.AddLarge("a", 2, 0);
  asked.turns.Expire();
  CHECK(asked.refused == std::vector{std::pair{std::string("a2"), StatusCode::kDeadlineExceeded}});
  asked.AddLarge("a", 1, 0);
  asked.turns.Expire();
  CHECK(asked.refused.back().first == "a1");
  asked.TurnUntil(1);
  CHECK(asked.answered == Names{"a3"});
  CHECK(asked.turns.empty());
}

TEST_CASE("a copy is known by its payload, whatever a peer sent around it, which is not kept") {
  Asked asked;
  asked.AddLarge("a", 1);
  const auto add = [&](int64_t deadline_ms, uint64_t id) {
    PendingRequest pending;
    pending.from = {"a", id};
    pending.deadline = Deadline::AfterMs(deadline_ms);
    pending.request.mutable_sample()->set_rows(5);
    for (int i = 0; i < 1000; ++i) pending.request.add_arrays()->set_name("array");
    pending.request.GetReflection()->MutableUnknownFields(&pending.request)->AddVarint(1000, 1);
    asked.AddPending(std::move(pending));
  };
  add(kNever, 2);
  add(0, 2);
  asked.turns.Expire();
  CHECK(asked.refused.size() == 1);
  asked.TurnUntil(1);
  CHECK(asked.turns.empty());
}

TEST_CASE("of the requests of one connection that wait the oldest makes room") {
  Asked asked;
  asked.AddLarge("a", 0);
  for (uint64_t id = 1; id <= limits::kMaxRequestsInFlight + 2; ++id) asked.AddLarge("a", id);
  asked.AddLarge("b", 0);
  CHECK(asked.refused == std::vector{std::pair{std::string("a1"), StatusCode::kLimitExceeded},
                                     {std::string("a2"), StatusCode::kLimitExceeded}});
  asked.refused.clear();
  asked.turns.RefuseAll(Status(StatusCode::kUnavailable, "over"));
  CHECK(asked.refused.size() == limits::kMaxRequestsInFlight + 2);
  CHECK(asked.turns.empty());
}

TEST_CASE("when too many requests wait, the connection that has the most gives way") {
  Asked asked;
  constexpr uint32_t kConnections = limits::kMaxQueuedRequests / limits::kMaxRequestsInFlight;
  for (uint32_t i = 0; i < kConnections; ++i) {
    for (uint64_t id = 1; id <= limits::kMaxRequestsInFlight; ++id) {
      asked.AddLarge("many" + std::to_string(i) + "-", id);
    }
  }
  CHECK(asked.refused.empty());
  asked.AddLarge("few-", 1);
  asked.AddLarge("few-", 2);
  REQUIRE(asked.refused.size() == 2);
  for (const auto& [name, code] : asked.refused) {
    CHECK(name.starts_with("many"));
    CHECK(code == StatusCode::kLimitExceeded);
  }
}

TEST_CASE("with little room one reply of each size is under way") {
  Asked asked(1);
  asked.AddLarge("a", 1);
  asked.AddLarge("b", 1);
  asked.AddSmall("c", 1);
  CHECK(asked.answered == Names{"c1"});
  const int first = asked.TurnUntil(2);
  // The other one was not begun before.
  CHECK(asked.TurnUntil(3) > first / 2);
  CHECK(asked.answered == Names{"c1", "a1", "b1"});
  CHECK(asked.turns.empty());
}

}  // namespace
}  // namespace b4mrl
