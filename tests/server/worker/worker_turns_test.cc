// In what portions a worker executes requests, and what becomes of those that it does not get done.
#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>

#include "server/worker/fault_point.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

constexpr uint32_t kManyLanes = 512;
// Of that many lanes: a bite is a tenth of a millisecond, and no machine does all of them in that.
constexpr int kFewestBites = 2;

std::vector<uint64_t> AllAt(uint64_t number) { return std::vector<uint64_t>(kManyLanes, number); }

pb::Request QueryRequest(uint64_t id = 0) {
  pb::Request request;
  request.set_request_id(id);
  request.mutable_query();
  return request;
}
pb::Request SnapshotRequest(uint64_t id = 0) {
  pb::Request request;
  request.set_request_id(id);
  request.mutable_snapshot();
  return request;
}
pb::Request RestoreRequest() {
  pb::Request request;
  request.mutable_restore();
  return request;
}

// Of a query.
std::vector<Input> Rows(uint32_t rows) {
  return {Array<float>("observations", {rows, 17}, std::vector<float>(rows * 17, 0.1f)),
          Actions(rows, 0.1f)};
}

// The array `name` of an answer, which must have it.
Input ArrayOf(const Answer& answer, const std::string& name) {
  const auto found = std::ranges::find(answer.envelope.arrays(), name, &pb::Array::name);
  REQUIRE(found != answer.envelope.arrays().end());
  Input array{name, static_cast<DType>(found->dtype()), {}, ""};
  uint64_t bytes = DTypeSize(array.dtype);
  for (const uint64_t extent : found->shape()) {
    array.shape.push_back(extent);
    bytes *= extent;
  }
  array.bytes = answer.payload.substr(found->offset(), bytes);
  return array;
}
bool Has(const Answer& answer, const std::string& name) {
  return std::ranges::count(answer.envelope.arrays(), name, &pb::Array::name) == 1;
}

TEST_CASE("Requests that nobody begins are answered at their deadline") {
  WorkerFixture worker;
  worker.Open(3);
  worker.Reset({1, 1, 1});
  worker.answers.clear();
  worker.Send(QueryRequest(), Rows(64), true);
  pb::Request late;
  std::vector<Input> inputs = {Lanes({1, 2})};
  SECTION("a query behind another one") {
    late = QueryRequest();
    inputs = Rows(4);
  }
  SECTION("a step") {
    late = WorkerFixture::StepRequest();
    inputs = {Lanes({1, 2}), Numbers({2, 2}), Actions(2, 0)};
  }
  SECTION("a snapshot") { late = SnapshotRequest(); }
  late.set_request_id(7);
  late.set_deadline_ms(1);
  worker.Send(late, inputs, true);
  worker.AwaitDeadline();
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].envelope.request_id() == 7);
  REQUIRE(worker.answers[0].code() == StatusCode::kDeadlineExceeded);
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
  // The lanes are free again, and none has moved.
  REQUIRE(worker.Step({2, 2, 2}, 0).code() == StatusCode::kOk);
}

TEST_CASE("A query that has begun ends at its deadline") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Call(QueryRequest(), Rows(64));  // measures rows, so that bites of them are taken
  pb::Request request = QueryRequest();
  request.set_deadline_ms(50);
  worker.answers.clear();
  worker.Send(request, Rows(limits::kMaxQueryRows), true);
  REQUIRE(worker.Bite());
  worker.AwaitDeadline();
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kDeadlineExceeded);
  REQUIRE(worker.dispatcher().idle());
}

TEST_CASE("Snapshots and restores of many lanes are executed in bites") {
  WorkerFixture worker;
  worker.Open(kManyLanes);
  worker.Reset(AllAt(1));
  // The first request of a kind measures its items, the second one is executed in bites.
  const Answer before = worker.Call(SnapshotRequest(), {});
  REQUIRE(before.code() == StatusCode::kOk);
  worker.Send(SnapshotRequest(), {}, true);
  REQUIRE(worker.Work() >= kFewestBites);
  REQUIRE(worker.answers.back().payload == before.payload);
  worker.Step(AllAt(2), 0.5f);
  std::vector<Input> state = {Numbers(AllAt(3))};
  SECTION("from a snapshot") { state.push_back(ArrayOf(before, "snapshot")); }
  SECTION("from parts") {
    for (const char* name : {"qpos", "qvel"}) state.push_back(ArrayOf(before, name));
  }
  REQUIRE(worker.Call(RestoreRequest(), state).code() == StatusCode::kOk);
  state[0] = Numbers(AllAt(4));
  worker.Send(RestoreRequest(), state, true);
  REQUIRE(worker.Work() >= kFewestBites);
  REQUIRE(worker.answers.back().code() == StatusCode::kOk);
  const Answer after = worker.Call(SnapshotRequest(), {});
  REQUIRE(ArrayOf(after, "qpos").bytes == ArrayOf(before, "qpos").bytes);
  REQUIRE(worker.Step(AllAt(5), 0).code() == StatusCode::kOk);
}

// How many items became dear, and were executed.
std::atomic<uint32_t> dear_items = 0;

// Makes a row or an operation of a lane take 5 ms, many times a bite.
void TakeLong(FaultPoint point, uint32_t, uint64_t, std::span<std::byte>) {
  if (point != FaultPoint::kBeforeQueryRow && point != FaultPoint::kBeforeOperation) return;
  ++dear_items;
  for (const Deadline end = Deadline::AfterMs(5); !end.expired();) {
  }
}

TEST_CASE("A bite of items that have become dear ends with the first of them, and the rest waits") {
  constexpr uint32_t kItems = 64;
  WorkerFixture worker;
  worker.Open(kItems);
  worker.Reset(std::vector<uint64_t>(kItems, 1));
  const bool steps = GENERATE(false, true);
  uint64_t number = 1;
  const auto send = [&] {
    const std::vector<uint64_t> numbers(kItems, ++number);
    if (steps) {
      worker.Send(WorkerFixture::StepRequest(), {Numbers(numbers), Actions(kItems, 0)}, true);
    } else {
      worker.Send(QueryRequest(), Rows(kItems), true);
    }
  };
  while (number < 10) {  // learns what the items take while they are cheap
    send();
    worker.Work();
  }
  const std::string before = worker.answers.back().payload;
  dear_items = 0;
  fault_hook = TakeLong;
  send();
  uint32_t most = 0;
  for (uint32_t earlier = 0; worker.Bite(); earlier = dear_items) {
    most = std::max(most, dear_items - earlier);
  }
  worker.Work();
  fault_hook = nullptr;
  CHECK(most <= 1);  // 0 on a machine so busy that the items have seemed dear before
  CHECK(dear_items == kItems);
  CHECK(worker.answers.back().code() == StatusCode::kOk);
  if (!steps) CHECK(worker.answers.back().payload == before);
  for (uint32_t lane = 0; lane < kItems; ++lane) {
    REQUIRE(worker.state().lane(lane).committed() == (steps ? number : 1));
  }
}

TEST_CASE("Parts of a state that share bytes are refused before they are copied") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  constexpr size_t kNumbers = limits::kLaneBufferBytes / sizeof(double);
  const std::vector<double> zeros(kNumbers, 0.0);
  const auto refusal = [&](const std::vector<Input>& parts) {
    const Answer answer = worker.Call(RestoreRequest(), parts);
    CHECK(answer.code() == StatusCode::kInvalidArgument);
    return answer.envelope.status().message();
  };
  const Input wide = Array<double>("qpos", {1, kNumbers}, zeros);
  CHECK(refusal({Numbers({2}), wide}).find("one lane's state") == std::string::npos);
  const Input one_more = Array<double>("qvel", {1, 1}, {0.0});
  CHECK(refusal({Numbers({2}), wide, one_more}).find("one lane's state") != std::string::npos);
}

TEST_CASE("A session's first item leaves the socket's thread free, later short ones run at once") {
  WorkerFixture worker;
  worker.Open(1);
  worker.answers.clear();
  pb::Request reset;
  reset.mutable_reset();
  worker.Send(reset, {Numbers({1})});
  REQUIRE(worker.answers.empty());
  REQUIRE(worker.Work() == 0);
  // A busy machine interrupts some resets for milliseconds, which count as costly for a while.
  bool ran_at_once = false;
  for (uint64_t number = 2; number < 10'000 && !ran_at_once; ++number) {
    worker.answers.clear();
    worker.Send(reset, {Numbers({number})});
    ran_at_once = worker.answers.size() == 1;
    worker.Work();
  }
  REQUIRE(ran_at_once);
}

TEST_CASE("A restore that fails for one lane of many restores none") {
  WorkerFixture worker(3);
  worker.Open(kManyLanes);
  worker.Reset(AllAt(1));
  const Answer before = worker.Call(SnapshotRequest(), {});
  Input damaged = ArrayOf(before, "snapshot");
  damaged.bytes[damaged.bytes.size() / 2] ^= 1;
  REQUIRE(worker.Step(AllAt(2), 0.5f).code() == StatusCode::kOk);
  const Answer expected = worker.Call(SnapshotRequest(), {});
  REQUIRE(worker.Call(RestoreRequest(), {Numbers(AllAt(3)), damaged}).code() ==
          StatusCode::kInvalidArgument);
  for (uint32_t lane = 0; lane < kManyLanes; ++lane) {
    REQUIRE(worker.state().lane(lane).committed() == 2);
  }
  REQUIRE(worker.Call(SnapshotRequest(), {}).payload == expected.payload);
}

TEST_CASE("A snapshot tells the parts of a state that all its lanes have, in one size") {
  WorkerFixture worker;
  worker.Open(2, kToken, "Highway");
  pb::Request reset;
  reset.mutable_reset();
  worker.Call(reset, {Lanes({0}), Numbers({1})});
  const Answer one_fresh = worker.Call(SnapshotRequest(), {});
  REQUIRE(one_fresh.code() == StatusCode::kOk);
  REQUIRE(one_fresh.envelope.arrays_size() == 1);
  worker.Call(reset, {Lanes({1}), Numbers({1})});
  const Answer equal = worker.Call(SnapshotRequest(), {});
  REQUIRE((Has(equal, "time") && Has(equal, "vehicles")));
  // Lane 1 goes on without its last cars.
  Input time = ArrayOf(equal, "time"), vehicles = ArrayOf(equal, "vehicles");
  const uint64_t bytes = vehicles.shape[1] * sizeof(double);
  time.shape[0] = vehicles.shape[0] = 1;
  time.bytes = time.bytes.substr(sizeof(double));
  vehicles.shape[1] /= 2;
  vehicles.bytes = vehicles.bytes.substr(bytes, bytes / 2);
  REQUIRE(worker.Call(RestoreRequest(), {Lanes({1}), Numbers({2}), time, vehicles}).code() ==
          StatusCode::kOk);
  const Answer differing = worker.Call(SnapshotRequest(), {});
  REQUIRE(differing.code() == StatusCode::kOk);
  REQUIRE((Has(differing, "time") && !Has(differing, "vehicles")));
  REQUIRE(ArrayOf(differing, "snapshot").shape[0] == 2);
}

}  // namespace
}  // namespace b4mrl
