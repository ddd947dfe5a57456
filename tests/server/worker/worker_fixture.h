// An environment worker without sockets: messages in, replies out, over shared memory of its own.
#pragma once

#include <poll.h>

#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/shared_memory/session_table.h"
#include "server/worker/dispatcher.h"
#include "server/worker/executor.h"

namespace b4mrl {

inline constexpr size_t kActions = 6;  // of HalfCheetah
inline const std::string kToken(limits::kTokenBytes, 'a');

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
inline Input Numbers(const std::vector<uint64_t>& numbers) {
  return Array<uint64_t>("numbers", {numbers.size()}, numbers);
}
inline Input Lanes(const std::vector<uint32_t>& lanes) {
  return Array<uint32_t>("lanes", {lanes.size()}, lanes);
}
inline Input Actions(size_t lanes, float value) {
  return Array<float>("actions", {lanes, kActions}, std::vector<float>(lanes * kActions, value));
}

class WorkerFixture {
 public:
  explicit WorkerFixture(uint32_t threads = 1) : threads_(threads) {
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
        *state_, 0, *executor_, memory,
        [this](const RoutingId& receiver, Message reply) {
          Answer answer;
          answer.receiver = receiver;
          REQUIRE(ParseEnvelope(reply.envelope, &answer.envelope).ok());
          answer.payload.assign(reply.payload.view());
          answers.push_back(std::move(answer));
        });
    dispatcher_->AdoptSessions();
  }

  // The record of a session whose Attach has not been sent.
  uint32_t Allocate(uint32_t lanes, const std::string& token = kToken,
                    const std::string& environment = "HalfCheetah") {
    open.set_environment(environment);
    open.set_num_envs(lanes);
    if (!open.has_seed()) open.set_seed(5);
    const std::string bytes = open.SerializeAsString();
    const Result<uint32_t> index = SessionTable(*state_).Allocate({token, bytes, 1, lanes});
    REQUIRE(index.ok());
    return *index;
  }
  pb::Request AttachRequest(uint32_t index) const {
    pb::Request attach;
    attach.mutable_attach()->set_session_index(index);
    attach.mutable_attach()->set_generation(state_->session(index).generation);
    *attach.mutable_session_token() = SessionToken(state_->session(index));
    return attach;
  }
  StatusCode Attach(uint32_t index) { return Call(AttachRequest(index), {}).code(); }
  uint32_t Open(uint32_t lanes, const std::string& token = kToken,
                const std::string& environment = "HalfCheetah") {
    const uint32_t index = Allocate(lanes, token, environment);
    REQUIRE(Attach(index) == StatusCode::kOk);
    REQUIRE(SessionTable(*state_).MakeLive(index));
    return index;
  }
  StatusCode Close(const std::string& token = kToken) {
    pb::Request close;
    close.set_session_token(token);
    close.mutable_close();
    return Call(close, {}).code();
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
  // One bite of what waits; false if there is none.
  bool Bite() { return executor_->RunBite(); }
  // Until all is answered; in so many bites.
  int Work() {
    int bites = 0;
    while (true) {
      dispatcher_->BuildNext(Clock::time_point::max());
      if (dispatcher_->idle()) return bites;
      // As the worker's loop does; the thread that waits for pictures must not find us spinning.
      if (Bite()) {
        ++bites;
      } else if (executor_->BeginWait()) {
        pollfd completion{executor_->completion_fd(), POLLIN, 0};
        poll(&completion, 1, 100);
      }
      executor_->EndWait();
      dispatcher_->FinishCompleted();
    }
  }
  // Looks after deadlines until there is an answer more, and executes nothing meanwhile.
  void AwaitDeadline() {
    const size_t before = answers.size();
    const Deadline patience = Deadline::AfterMs(10'000);
    while (answers.size() == before && !patience.expired()) {
      dispatcher_->EndExpired();
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
  WorkerShares memory = WorkerSharesOf(uint64_t{32} << 30);  // of the next replacement
  pb::OpenRequest open;  // of the sessions that Allocate and Open make from now on

 private:
  uint32_t threads_;
  uint64_t next_id_ = 1000;
  std::unique_ptr<SharedState> state_;
  std::unique_ptr<Executor> executor_;
  std::unique_ptr<Dispatcher> dispatcher_;
};

// Opens session `i` of many, whose lanes are all reset.
inline std::string OpenNumbered(WorkerFixture& worker, uint32_t i, uint32_t lanes) {
  const std::string digits = std::to_string(i);
  const std::string token = std::string(limits::kTokenBytes - digits.size(), 't') + digits;
  worker.Open(lanes, token);
  pb::Request reset;
  reset.set_session_token(token);
  reset.mutable_reset();
  REQUIRE(worker.Call(reset, {Numbers(std::vector<uint64_t>(lanes, 1))}).code() == StatusCode::kOk);
  return token;
}

}  // namespace b4mrl
