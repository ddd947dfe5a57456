// Requests of which a worker that died has executed some lanes: what their copies are told.
#include <catch2/catch.hpp>

#include "server/shared_memory/blame.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

// Crashes often enough that this attempt of the lane's operation is refused.
void Blame(WorkerFixture& worker, uint32_t lane, uint64_t number, uint64_t attempt) {
  for (int death = 0; death < 2; ++death) {
    worker.state().lane(lane).AddBlame(number, attempt, kCrashBlame);
  }
}

Answer ResetSeeded(WorkerFixture& worker, const std::vector<uint32_t>& lanes,
                   const std::vector<uint64_t>& seeds) {
  pb::Request reset;
  reset.mutable_reset();
  const std::vector<uint64_t> numbers(lanes.size(), 1);
  return worker.Call(
      reset, {Lanes(lanes), Numbers(numbers), Array<uint64_t>("seeds", {seeds.size()}, seeds)});
}

bool SaysThatSomeWereDone(const Answer& answer) {
  return answer.code() == StatusCode::kInternal && !answer.envelope.status().recoverable() &&
         answer.envelope.status().message().find("other lanes") != std::string::npos;
}

TEST_CASE(
    "A reset that is refused for one lane does not say that nothing was executed, if it was") {
  WorkerFixture worker;
  worker.Open(4);
  const Answer first = ResetSeeded(worker, {0, 1, 2}, {11, 12, 13});
  REQUIRE(first.code() == StatusCode::kOk);
  Blame(worker, 3, 1, AttemptKey(Operation::kReset, 14));
  const Answer refused = ResetSeeded(worker, {0, 1, 2, 3}, {11, 12, 13, 14});
  CHECK(SaysThatSomeWereDone(refused));
  CHECK(refused.envelope.status().message().find("lane 3") != std::string::npos);
  // Alone, every lane tells what became of it.
  CHECK(ResetSeeded(worker, {0, 1, 2}, {11, 12, 13}).payload == first.payload);
  CHECK(ResetSeeded(worker, {3}, {14}).code() == StatusCode::kFailedPrecondition);
  CHECK(ResetSeeded(worker, {3}, {15}).code() == StatusCode::kOk);
}

TEST_CASE("A reset of several lanes that is refused for one has executed none") {
  WorkerFixture worker;
  worker.Open(4);
  Blame(worker, 3, 1, AttemptKey(Operation::kReset, 14));
  CHECK(ResetSeeded(worker, {0, 1, 2, 3}, {11, 12, 13, 14}).code() ==
        StatusCode::kFailedPrecondition);
  for (uint32_t lane = 0; lane < 4; ++lane) CHECK(worker.state().lane(lane).committed() == 0);
  CHECK(ResetSeeded(worker, {0, 1, 2, 3}, {21, 22, 23, 24}).code() == StatusCode::kOk);
}

TEST_CASE("A restore that is refused for one lane does not say that nothing was executed") {
  WorkerFixture worker;
  worker.Open(2);
  worker.Reset({1, 1});
  pb::Request snapshot, restore;
  snapshot.mutable_snapshot();
  restore.mutable_restore();
  const Answer state = worker.Call(snapshot, {Lanes({0})});
  const uint64_t bytes = state.envelope.arrays(0).shape(1);
  const std::vector<uint8_t> blob(state.payload.begin(),
                                  state.payload.begin() + static_cast<ptrdiff_t>(bytes));
  std::vector<uint8_t> blobs = blob;
  blobs.insert(blobs.end(), blob.begin(), blob.end());
  const auto both = [&] {
    return worker.Call(restore, {Numbers({2, 2}), Array<uint8_t>("snapshot", {2, bytes}, blobs)});
  };
  Blame(worker, 1, 2, AttemptKey(Operation::kRestore));
  CHECK(both().code() == StatusCode::kFailedPrecondition);
  REQUIRE(
      worker.Call(restore, {Lanes({0}), Numbers({2}), Array<uint8_t>("snapshot", {1, bytes}, blob)})
          .code() == StatusCode::kOk);
  CHECK(SaysThatSomeWereDone(both()));
}

TEST_CASE("A late copy of a step of which some lanes were executed does not say that none was") {
  WorkerFixture worker;
  worker.Open(4);
  worker.Reset({1, 1, 1, 1});
  REQUIRE(worker
              .Call(WorkerFixture::StepRequest(),
                    {Lanes({0, 1, 3}), Numbers({2, 2, 2}), Actions(3, 0.5f)})
              .code() == StatusCode::kOk);
  pb::Request copy = WorkerFixture::StepRequest();
  copy.set_deadline_ms(1);
  worker.answers.clear();
  worker.Send(copy, {Numbers({2, 2, 2, 2}), Actions(4, 0.5f)}, /*waiting=*/true);
  worker.AwaitDeadline();
  REQUIRE(worker.answers.size() == 1);
  CHECK(SaysThatSomeWereDone(worker.answers[0]));
  CHECK(worker.answers[0].envelope.status().message().find("deadline") != std::string::npos);
  CHECK(worker.state().lane(2).committed() == 1);
  CHECK(worker.Step({2, 2, 2, 2}, 0.5f).code() == StatusCode::kOk);
}

}  // namespace
}  // namespace b4mrl
