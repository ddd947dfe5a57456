// An environment worker without sockets: messages in, replies out.
#include "server/dispatcher.h"

#include <google/protobuf/stubs/logging.h>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "proto/base/rng.h"
#include "server/executor.h"
#include "server/session_table.h"

namespace b4mrl {
namespace {

constexpr size_t kActions = 6;  // of HalfCheetah
const std::string kToken(limits::kTokenBytes, 'a');

struct Answer {
  RoutingId receiver;
  pb::Reply envelope;
  std::string payload;

  StatusCode code() const { return GetStatus(envelope.status()).code(); }
};

// One array of a request: uint64, uint32 or float elements.
struct Input {
  std::string name;
  DType dtype;
  std::vector<uint64_t> shape;
  std::string bytes;
};
template <typename T>
Input Array(const std::string& name, std::vector<uint64_t> shape, const std::vector<T>& values) {
  return {name, DTypeOf<T>(), std::move(shape),
          std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T))};
}
Input Numbers(const std::vector<uint64_t>& numbers) {
  return Array<uint64_t>("numbers", {numbers.size()}, numbers);
}
Input Lanes(const std::vector<uint32_t>& lanes) {
  return Array<uint32_t>("lanes", {lanes.size()}, lanes);
}
Input Actions(size_t lanes, float value) {
  return Array<float>("actions", {lanes, kActions}, std::vector<float>(lanes * kActions, value));
}

class Fixture {
 public:
  explicit Fixture(uint32_t threads = 1) : threads_(threads) {
    Result<SharedState> state = SharedState::Create(1, limits::kLoopbackLeaseMs);
    REQUIRE(state.ok());
    state_ = std::make_unique<SharedState>(std::move(*state));
    Restart();
  }

  // A replacement over the same shared memory.
  void Restart() {
    dispatcher_.reset();
    executor_.reset();
    executor_ = std::make_unique<Executor>(threads_, state_->marks(0));
    dispatcher_ = std::make_unique<Dispatcher>(
        *state_, 0, "", *executor_, [this](const RoutingId& receiver, Message reply) {
          Answer answer;
          answer.receiver = receiver;
          REQUIRE(ParseEnvelope(reply.envelope, &answer.envelope).ok());
          answer.payload.assign(reply.payload.view());
          answers.push_back(std::move(answer));
        });
    dispatcher_->AdoptSessions();
  }

  uint32_t Open(uint32_t lanes, const std::string& token = kToken) {
    pb::OpenRequest open;
    open.set_environment("HalfCheetah");
    open.set_num_envs(lanes);
    open.set_seed(5);
    SessionTable table(*state_);
    const std::string bytes = open.SerializeAsString();
    const Result<uint32_t> index = table.Allocate({token, bytes, 1, lanes});
    REQUIRE(index.ok());
    pb::Request attach;
    attach.mutable_attach()->set_session_index(*index);
    REQUIRE(Call(attach, {}).code() == StatusCode::kOk);
    table.MakeLive(*index);
    return *index;
  }

  // Hands a message over. `waiting` keeps its work in the queue until Work().
  void Send(pb::Request request, const std::vector<Input>& inputs, bool waiting = false,
            const RoutingId& sender = "client") {
    request.set_protocol_version(limits::kProtocolVersion);
    if (request.session_token().empty()) request.set_session_token(kToken);
    if (request.request_id() == 0) request.set_request_id(next_id_++);
    std::string payload;
    for (const Input& input : inputs) {
      payload.resize((payload.size() + 63) / 64 * 64);
      pb::Array* array = request.add_arrays();
      array->set_name(input.name);
      array->set_dtype(static_cast<pb::DType>(input.dtype));
      for (const uint64_t extent : input.shape) array->add_shape(extent);
      array->set_offset(payload.size());
      payload += input.bytes;
    }
    Deliver(request.SerializeAsString(), payload, waiting, sender);
  }
  void Deliver(const std::string& envelope, const std::string& payload, bool waiting,
               const RoutingId& sender) {
    Message message{Frame::Copy(envelope), payload.empty() ? Frame() : Frame::Copy(payload)};
    dispatcher_->Handle({sender, std::move(message)}, waiting);
  }
  void Work() {
    while (!dispatcher_->idle()) {
      executor_->RunBite();
      dispatcher_->FinishCompleted();
    }
  }
  // The answer to one message.
  Answer Call(pb::Request request, const std::vector<Input>& inputs) {
    const size_t before = answers.size();
    Send(std::move(request), inputs);
    Work();
    REQUIRE(answers.size() == before + 1);
    return answers.back();
  }
  Answer Reset(const std::vector<uint64_t>& numbers) {
    pb::Request request;
    request.mutable_reset();
    return Call(request, {Numbers(numbers)});
  }
  Answer Step(const std::vector<uint64_t>& numbers, float action) {
    return Call(StepRequest(), {Numbers(numbers), Actions(numbers.size(), action)});
  }
  static pb::Request StepRequest(uint64_t id = 0) {
    pb::Request request;
    request.set_request_id(id);
    request.mutable_step();
    return request;
  }

  SharedState& state() { return *state_; }
  Dispatcher& dispatcher() { return *dispatcher_; }
  std::vector<Answer> answers;

 private:
  uint32_t threads_;
  uint64_t next_id_ = 1000;
  std::unique_ptr<SharedState> state_;
  std::unique_ptr<Executor> executor_;
  std::unique_ptr<Dispatcher> dispatcher_;
};

TEST_CASE("The same number is answered with the same bytes, whatever the action says then") {
  Fixture worker;
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
  Fixture both;
  both.Open(2);
  both.Reset({1, 1});
  const Answer together = both.Step({2, 2}, 0.5f);

  Fixture apart;
  apart.Open(2);
  apart.Reset({1, 1});
  apart.Send(Fixture::StepRequest(), {Numbers({2}), Lanes({1}), Actions(1, 0.5f)});
  apart.Work();
  REQUIRE(apart.Step({2, 2}, 0.5f).payload == together.payload);
  REQUIRE(apart.state().lane(1).committed() == 2);
}

TEST_CASE("A request resent while it waits is executed once and answered to the newest sender") {
  Fixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  const std::vector<Input> inputs = {Numbers({2}), Actions(1, 0.1f)};
  worker.Send(Fixture::StepRequest(7), inputs, true, "old connection");
  worker.Send(Fixture::StepRequest(7), inputs, true, "new connection");
  worker.Work();
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].receiver == "new connection");
  REQUIRE(worker.state().lane(0).committed() == 2);
}

TEST_CASE("A request id under way with other contents is refused") {
  Fixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  worker.Send(Fixture::StepRequest(7), {Numbers({2}), Actions(1, 0.1f)}, true);
  worker.Send(Fixture::StepRequest(7), {Numbers({2}), Actions(1, 0.2f)}, true);
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kInvalidArgument);
  worker.Work();
  REQUIRE(worker.answers[1].code() == StatusCode::kOk);
}

TEST_CASE("A busy lane refuses other requests, and other lanes go on") {
  Fixture worker;
  worker.Open(2);
  worker.Reset({1, 1});
  worker.answers.clear();
  worker.Send(Fixture::StepRequest(1), {Numbers({2}), Lanes({0}), Actions(1, 0)}, true);
  worker.Send(Fixture::StepRequest(2), {Numbers({2}), Lanes({0}), Actions(1, 0)}, true);
  pb::Request snapshot;
  snapshot.set_request_id(3);
  snapshot.mutable_snapshot();
  worker.Send(snapshot, {}, true);
  worker.Send(Fixture::StepRequest(4), {Numbers({2}), Lanes({1}), Actions(1, 0)}, true);
  worker.Work();
  std::map<uint64_t, StatusCode> codes;
  for (const Answer& answer : worker.answers) codes[answer.envelope.request_id()] = answer.code();
  REQUIRE(codes == std::map<uint64_t, StatusCode>{{1, StatusCode::kOk},
                                                  {2, StatusCode::kBusy},
                                                  {3, StatusCode::kBusy},
                                                  {4, StatusCode::kOk}});
}

TEST_CASE("Nothing is stepped after the deadline, and the number stays free") {
  Fixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  pb::Request request = Fixture::StepRequest();
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
  Fixture worker;
  worker.Open(2);
  const StatusCode invalid = StatusCode::kInvalidArgument;
  const auto step = [&](const std::vector<Input>& inputs) {
    return worker.Call(Fixture::StepRequest(), inputs).code();
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
  pb::Request unknown = Fixture::StepRequest();
  unknown.set_session_token(std::string(limits::kTokenBytes, 'x'));
  REQUIRE(worker.Call(unknown, {}).code() == StatusCode::kSessionLost);
}

TEST_CASE("Requests in flight are limited") {
  Fixture worker;
  worker.Open(limits::kMaxRequestsInFlight + 1);
  worker.Reset(std::vector<uint64_t>(limits::kMaxRequestsInFlight + 1, 1));
  worker.answers.clear();
  for (uint32_t lane = 0; lane <= limits::kMaxRequestsInFlight; ++lane) {
    worker.Send(Fixture::StepRequest(), {Numbers({2}), Lanes({lane}), Actions(1, 0)}, true);
  }
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
  REQUIRE(worker.answers.size() == limits::kMaxRequestsInFlight + 1);
}

TEST_CASE("Close waits for what is under way, and closing twice is closing once") {
  Fixture worker;
  const uint32_t index = worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  pb::Request close;
  close.mutable_close();
  worker.Send(Fixture::StepRequest(), {Numbers({2}), Actions(1, 0)}, true);
  worker.Send(close, {}, true);
  worker.Send(Fixture::StepRequest(), {Numbers({3}), Actions(1, 0)}, true);
  worker.Work();
  REQUIRE(worker.answers.size() == 3);
  REQUIRE(worker.answers[0].code() == StatusCode::kSessionLost);  // came after the Close
  REQUIRE(worker.answers[1].envelope.has_step());
  REQUIRE(worker.answers[2].envelope.has_close());
  REQUIRE(worker.state().session(index).state == SessionState::kClosed);
  REQUIRE(worker.Call(close, {}).code() == StatusCode::kOk);
}

TEST_CASE("A session that nobody uses ends when its lease does") {
  Fixture worker;
  const uint32_t index = worker.Open(1);
  worker.dispatcher().ReapIdleSessions();
  REQUIRE(worker.dispatcher().session_count() == 1);
  worker.state().session(index).last_activity_ms -= limits::kLoopbackLeaseMs + 1;
  worker.dispatcher().ReapIdleSessions();
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.Reset({1}).code() == StatusCode::kSessionLost);
}

TEST_CASE("A replacement continues every session with the same bytes") {
  Fixture undisturbed;
  undisturbed.Open(3);
  undisturbed.Reset({1, 1, 1});
  undisturbed.Step({2, 2, 2}, 0.3f);
  const Answer expected = undisturbed.Step({3, 3, 3}, -0.3f);

  Fixture worker;
  worker.Open(3);
  worker.Reset({1, 1, 1});
  const Answer second = worker.Step({2, 2, 2}, 0.3f);
  worker.Restart();
  REQUIRE(worker.Step({2, 2, 2}, 0.3f).payload == second.payload);
  REQUIRE(worker.Step({3, 3, 3}, -0.3f).payload == expected.payload);
}

TEST_CASE("A replacement gives up a damaged session and keeps the others") {
  Fixture worker;
  const uint32_t damaged = worker.Open(2);
  const std::string other(limits::kTokenBytes, 'b');
  worker.Open(1, other);
  worker.Reset({1, 1});
  SECTION("its record") { worker.state().session(damaged).open[0] ^= std::byte{1}; }
  SECTION("a lane's record") {
    const auto record = worker.state().lane(1).committed_record();
    const_cast<std::byte&>(record[100]) ^= std::byte{1};
  }
  worker.Restart();
  REQUIRE(worker.Step({2, 2}, 0).code() == StatusCode::kSessionLost);
  REQUIRE(worker.dispatcher().session_count() == 1);
  pb::Request reset;
  reset.set_session_token(other);
  reset.mutable_reset();
  REQUIRE(worker.Call(reset, {Numbers({1})}).code() == StatusCode::kOk);
}

TEST_CASE("A session whose rebuilding ends its worker is given up after three attempts") {
  Fixture worker;
  const uint32_t index = worker.Open(1);
  worker.state().session(index).adoption_attempts.store(3);
  worker.Restart();
  REQUIRE(worker.dispatcher().session_count() == 0);
  REQUIRE(worker.state().session(index).state == SessionState::kClosed);
}

TEST_CASE("Snapshots continue exactly, and damaged or foreign ones are refused") {
  Fixture worker;
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
  Fixture worker(2);
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
