// Opens between clients that the test plays and workers that it plays as well.
#pragma once

#include <catch2/catch.hpp>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/gateway/openings.h"
#include "tests/client/fake_server.h"
#include "tests/results.h"
#include "tests/server/models/compiler_script.h"

namespace b4mrl {

inline std::string Token(uint64_t number) {
  std::string token(limits::kTokenBytes, 't');
  std::memcpy(token.data(), &number, sizeof(number));
  return token;
}

inline pb::Request Open(uint64_t id, const std::string& token, uint32_t deadline_ms = 60'000) {
  pb::Request request;
  request.set_request_id(id);
  request.set_session_token(token);
  request.set_deadline_ms(deadline_ms);
  request.mutable_open()->set_environment("HalfCheetah");  // no lanes: for Query alone
  request.mutable_open()->set_seed(1);
  return request;
}

class OpeningsFixture {
  SocketFolder folder_;
  Context sockets_;  // outlives the openings
  SharedState state_;
  DataFolder folder_of_data_{"/tmp"};

 public:
  static constexpr int64_t kPatienceMs = 30'000;

  explicit OpeningsFixture(uint32_t worker_count = 1)
      : state_(Take(SharedState::Create(worker_count, 1'000))) {
    std::vector<DealerSocket> workers;
    for (uint32_t i = 0; i < worker_count; ++i) {
      state_.child(kFirstWorkerChild + i).process_id = 1;
      workers.push_back(Take(DealerSocket::Connect(sockets_, folder_.Address(NameOf(i)))));
    }
    const Openings::Options options{script.options(), {{.tcp = 7701, .ipc = ""}}};
    openings.emplace(state_, std::move(workers), options, folder_of_data_,
                     [this](const Asker& to, const Result<pb::Reply>& opened) {
                       answers[{to.peer, to.request_id}].push_back(opened.status());
                     });
  }
  SharedState& state() { return state_; }

  CompilerScript script;
  std::unique_ptr<FakeServer> worker;  // the one that was started last
  std::optional<Openings> openings;
  std::map<std::pair<RoutingId, uint64_t>, std::vector<Status>> answers;

  // A new process behind the same address; what the old one held is lost.
  void StartWorker() {
    worker.reset();
    worker = std::make_unique<FakeServer>(folder_.Address(NameOf(0)));
  }
  static std::string NameOf(uint32_t index) { return "worker" + std::to_string(index); }
  std::unique_ptr<FakeServer> WorkerOf(uint32_t index) const {
    return std::make_unique<FakeServer>(folder_.Address(NameOf(index)));
  }
  // The worker lacks memory for the session.
  void Refuse(const FakeCall& call) {
    pb::Reply reply;
    SetStatus(Status(StatusCode::kLimitExceeded, "no memory"), reply.mutable_status());
    worker->Reply(call, reply);
  }
  void Ask(const RoutingId& peer, const pb::Request& request) {
    openings->Open({peer, request.request_id()}, request);
  }
  StatusCode AnswerTo(const RoutingId& peer, uint64_t id) {
    const std::vector<Status>& all = answers[{peer, id}];
    REQUIRE(all.size() == 1);
    return all[0].code();
  }
  // The next Attach that the worker gets.
  FakeCall TakeAttach() {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!deadline.expired()) {
      openings->Pump();
      if (std::optional<FakeCall> call = worker->Take(1)) return std::move(*call);
    }
    FAIL("no Attach arrived");
    return {};
  }
  void Attached(const FakeCall& call) {
    pb::Reply reply;
    reply.mutable_attach()->set_experiment_id("experiment");
    worker->Reply(call, reply);
  }
  // Asks for a session of its own with a model of the user's.
  void AskForModel(const RoutingId& peer, uint64_t id, const std::string& file,
                   uint32_t deadline_ms = 60'000) {
    script.Drop(file);
    pb::Request request = Open(id, Token(id), deadline_ms);
    pb::NamedArgument* model = request.mutable_open()->add_perturbations();
    model->set_name("model");
    model->set_argument(file);
    Ask(peer, request);
  }
  // Pumps, as seldom as the gateway would, until the condition holds.
  template <typename Condition>
  void Await(const Condition& holds) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!holds() && !deadline.expired()) PumpOnce();
    REQUIRE(holds());
  }
  void AwaitAnswers() {
    Await([this] { return openings->empty(); });
  }
  StatusCode AwaitAnswerTo(const RoutingId& peer, uint64_t id) {
    Await([&] { return answers.contains({peer, id}); });
    return AnswerTo(peer, id);
  }
  void PumpOnce() {
    std::vector<void*> sockets;
    std::vector<int> descriptors;
    openings->AppendSockets(&sockets);
    openings->AppendDescriptors(&descriptors);
    WaitAnyReadable(sockets, openings->wait_ms(100), descriptors);
    openings->Pump();
  }
};

}  // namespace b4mrl
