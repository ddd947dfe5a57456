// What an environment worker makes of what others left in shared memory, in snapshots and on the
// wire.
#include <google/protobuf/stubs/logging.h>

#include <catch2/catch.hpp>
#include <cstring>

#include "proto/base/rng.h"
#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("A replacement continues every session with the same bytes") {
  WorkerFixture undisturbed;
  undisturbed.Open(3);
  undisturbed.Reset({1, 1, 1});
  undisturbed.Step({2, 2, 2}, 0.3f);
  const Answer expected = undisturbed.Step({3, 3, 3}, -0.3f);

  WorkerFixture worker;
  worker.Open(3);
  worker.Reset({1, 1, 1});
  const Answer second = worker.Step({2, 2, 2}, 0.3f);
  worker.Restart();
  REQUIRE(worker.Step({2, 2, 2}, 0.3f).payload == second.payload);
  REQUIRE(worker.Step({3, 3, 3}, -0.3f).payload == expected.payload);
}

TEST_CASE("A replacement gives up a damaged session and keeps the others") {
  WorkerFixture worker;
  const uint32_t damaged = worker.Open(2);
  const std::string other(limits::kTokenBytes, 'b');
  worker.Open(1, other);
  worker.Reset({1, 1});
  SECTION("its record") { worker.state().session(damaged).open[0] ^= std::byte{1}; }
  SECTION("a lane's record") {
    const auto record = worker.state().lane(1).committed_record();
    const_cast<std::byte&>(record[100]) ^= std::byte{1};
  }
  // With another one its lanes would go on by other physics.
  SECTION("its simulator") { ++worker.state().session(damaged).simulator_hash; }
  worker.Restart();
  REQUIRE(worker.Step({2, 2}, 0).code() == StatusCode::kSessionLost);
  REQUIRE(worker.dispatcher().session_count() == 1);
  pb::Request reset;
  reset.set_session_token(other);
  reset.mutable_reset();
  REQUIRE(worker.Call(reset, {Numbers({1})}).code() == StatusCode::kOk);
}

TEST_CASE("A session whose rebuilding ended its worker three times is given up") {
  WorkerFixture worker;
  const uint32_t index = worker.Open(1);
  worker.state().session(index).build_deaths.store(kMaxBuildDeaths - 1);
  worker.Restart();
  REQUIRE(worker.dispatcher().session_count() == 1);
  REQUIRE(worker.state().session(index).build_deaths == 0);  // it went well
  worker.state().session(index).build_deaths.store(kMaxBuildDeaths);
  worker.Restart();
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.state().session(index).state() == SessionState::kClosed);
}

TEST_CASE("Snapshots continue exactly, and damaged or foreign ones are refused") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.Step({2}, 0.2f);
  pb::Request request;
  request.mutable_snapshot();
  const Answer snapshot = worker.Call(request, {});
  REQUIRE(snapshot.code() == StatusCode::kOk);
  const uint64_t bytes = snapshot.envelope.arrays(0).shape(1);
  std::vector<uint8_t> blob(snapshot.payload.begin(),
                            snapshot.payload.begin() + static_cast<ptrdiff_t>(bytes));
  const Answer expected = worker.Step({3}, 0.7f);
  pb::Request restore;
  restore.mutable_restore();
  const auto restore_at = [&](uint64_t number) {
    return worker.Call(restore, {Numbers({number}), Array<uint8_t>("snapshot", {1, bytes}, blob)});
  };
  REQUIRE(restore_at(4).code() == StatusCode::kOk);
  REQUIRE(worker.Step({5}, 0.7f).payload == expected.payload);
  SECTION("damaged") {
    blob[bytes - 1] ^= 1;
    REQUIRE(restore_at(6).code() == StatusCode::kInvalidArgument);
  }
  SECTION("of another simulator") {
    blob[16] ^= 1;  // SnapshotHeader::simulator_hash
    REQUIRE(restore_at(6).code() == StatusCode::kVersionMismatch);
  }
  REQUIRE(worker.state().lane(0).committed() == 5);
}

TEST_CASE("A Restore sent again is answered with the same observation, and executed once") {
  WorkerFixture worker;
  worker.Open(2);
  worker.Reset({1, 1});
  pb::Request restore;
  restore.mutable_restore();
  const auto restore_lane = [&](uint32_t lane, double position) {
    const std::vector<double> positions(9, position), velocities(9, 0);
    const Answer answer =
        worker.Call(restore, {Numbers({2}), Lanes({lane}), Array<double>("qpos", {1, 9}, positions),
                              Array<double>("qvel", {1, 9}, velocities)});
    REQUIRE(answer.code() == StatusCode::kOk);
    return answer.payload;
  };
  // The two lanes in turn, so that no reply finds its bytes left over in the memory it is given.
  const std::string first = restore_lane(0, 0.25), second = restore_lane(1, 0.5);
  REQUIRE(first != second);
  REQUIRE(restore_lane(0, 0.25) == first);
  REQUIRE(restore_lane(1, 0.5) == second);
  REQUIRE(restore_lane(0, 0.75) == first);  // what is sent then does not matter
  REQUIRE(worker.state().lane(0).committed() == 2);
}

// Changes some bytes, or cuts or extends the string.
std::string Mutate(std::string text, Rng& rng) {
  const uint64_t changes = rng.Below(4);
  for (uint64_t i = 0; i < changes && !text.empty(); ++i) {
    text[rng.Below(text.size())] = static_cast<char>(rng.Below(256));
  }
  if (rng.Below(4) == 0) text.resize(rng.Below(text.size() + 1));
  if (rng.Below(8) == 0) text.append(rng.Below(100), static_cast<char>(rng.Below(256)));
  return text;
}

TEST_CASE("Every mutated message is answered exactly once, and the session survives") {
  WorkerFixture worker(2);
  worker.Open(2);
  worker.Reset({1, 1});
  google::protobuf::SetLogHandler(nullptr);  // as the server does
  Rng rng(1, "mutations");
  uint64_t sent = 0;
  worker.answers.clear();
  for (int round = 0; round < 20'000; ++round) {
    pb::Request request;
    request.set_protocol_version(limits::kProtocolVersion);
    request.set_request_id(rng.NextUint64());
    request.set_session_token(kToken);
    const uint64_t next = worker.state().lane(0).committed() + 1;
    std::string payload(256, '\0');
    std::memcpy(payload.data() + 64, &next, sizeof(next));
    pb::Array* first = request.add_arrays();
    first->set_name(rng.Below(2) ? "actions" : "observations");
    first->set_dtype(pb::FLOAT32);
    first->add_shape(1);
    first->add_shape(first->name() == "actions" ? 6 : 17);
    pb::Array* numbers = request.add_arrays();
    numbers->set_name("numbers");
    numbers->set_dtype(pb::UINT64);
    numbers->set_offset(64);
    numbers->add_shape(1);
    pb::Array* lanes = request.add_arrays();
    lanes->set_name("lanes");
    lanes->set_dtype(pb::UINT32);
    lanes->set_offset(128);
    lanes->add_shape(1);
    const uint64_t kind = rng.Below(4);
    if (kind == 0) request.mutable_step();
    if (kind == 1) request.mutable_query();
    if (kind == 2) request.mutable_restore();
    if (kind == 3) request.mutable_attach()->set_session_index(static_cast<uint32_t>(rng.Below(9)));
    worker.Deliver(Mutate(request.SerializeAsString(), rng), Mutate(payload, rng),
                   rng.Below(2) == 0, "mutant");
    ++sent;
    worker.Work();
  }
  REQUIRE(worker.answers.size() == sent);
  REQUIRE(worker.dispatcher().session_count() == 1);
  const uint64_t next = worker.state().lane(0).committed() + 1;
  REQUIRE(next > 100);  // enough of them were intact to step the lanes
  const uint64_t other = worker.state().lane(1).committed() + 1;
  REQUIRE(worker.Reset({next, other}).code() == StatusCode::kOk);
}

}  // namespace
}  // namespace b4mrl
