// The relay between sockets that the test holds: it plays the processes and the gateway's clients.
#pragma once

#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "proto/base/limits.h"
#include "server/gateway/relay.h"
#include "tests/client/fake_server.h"

namespace b4mrl {

inline std::string Token(char letter) { return std::string(limits::kTokenBytes, letter); }

inline pb::Request Query(uint64_t id, const std::string& token, uint32_t deadline_ms = 10'000) {
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(id);
  request.set_session_token(token);
  request.set_deadline_ms(deadline_ms);
  request.mutable_query()->set_seed(id);
  return request;
}

inline pb::Request Sample(uint64_t id) {
  pb::Request request = Query(id, "");
  request.mutable_sample()->set_rows(1);
  return request;
}

struct HandedBack {
  RoutingId client;
  uint64_t id;
};

class RelayFixture {
  SocketFolder folder_;
  Context sockets_;  // outlives the relay
  SharedState state_;
  SessionTable table_;
  std::map<size_t, Frame> payloads_;

 public:
  static constexpr int64_t kPatienceMs = 20'000;
  static constexpr uint32_t kWorkers = 2;

  explicit RelayFixture(Relay::Limits relayed = {})
      : state_(std::move(*SharedState::Create(kWorkers, 1'000))), table_(state_) {
    Relay::Addresses addresses;
    for (uint32_t i = 0; i < kWorkers; ++i) addresses.workers.push_back(WorkerAddress(i));
    addresses.dataset_worker = folder_.Address("dataset");
    for (uint32_t i = 0; i < kWorkers; ++i) Restart(i);
    dataset_worker = std::make_unique<FakeServer>(addresses.dataset_worker);
    relay = std::make_unique<Relay>(
        sockets_, state_, addresses,
        [this](const RoutingId& client, Message reply) { return HandBack(client, reply); },
        relayed);
  }

  std::unique_ptr<FakeServer> workers[kWorkers];
  std::unique_ptr<FakeServer> dataset_worker;
  std::unique_ptr<Relay> relay;
  std::vector<HandedBack> handed_back;
  std::set<RoutingId> gone_clients;

  // A new process behind the same address; what the old one held is lost.
  void Restart(uint32_t worker) {
    workers[worker].reset();
    workers[worker] = std::make_unique<FakeServer>(WorkerAddress(worker));
  }
  // A live session on the worker with the fewest lanes: the first one on worker 0.
  uint32_t Open(const std::string& token) {
    const Result<uint32_t> index = table_.Allocate({token, "request", 1, 1});
    REQUIRE(index.ok());
    table_.MakeLive(*index);
    return *index;
  }
  void Close(uint32_t session) {
    state_.session(session).Close(state_.session(session).generation);
  }

  Status Forward(const RoutingId& client, const pb::Request& request, size_t payload_bytes = 0) {
    return relay->Forward(client, request,
                          {Frame::Copy(request.SerializeAsString()), Payload(payload_bytes)});
  }
  // Pumps until `process` has a request.
  FakeCall Take(FakeServer& process) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!deadline.expired()) {
      relay->Pump();
      if (std::optional<FakeCall> call = process.Take(1)) return std::move(*call);
    }
    FAIL("nothing arrived");
    return {};
  }
  // Pumps until `count` replies have been handed back.
  void AwaitReplies(size_t count) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (handed_back.size() < count && !deadline.expired()) PumpWhenReady();
    REQUIRE(handed_back.size() == count);
  }
  void PumpWhenReady() {
    std::vector<void*> sockets;
    relay->AppendSockets(&sockets);
    WaitAnyReadable(sockets, 1);
    relay->Pump();
  }

 private:
  std::string WorkerAddress(uint32_t i) const {
    return folder_.Address("worker-" + std::to_string(i));
  }
  // Payloads of one size share their bytes, so that copies of a request are equal.
  Frame Payload(size_t bytes) {
    if (bytes == 0) return Frame();
    const auto [payload, is_new] = payloads_.try_emplace(bytes);
    if (is_new) payload->second = Frame::OfSize(bytes);
    return payload->second.Share();
  }
  Status HandBack(const RoutingId& client, const Message& reply) {
    if (gone_clients.contains(client)) return {StatusCode::kUnavailable, "gone"};
    pb::Reply envelope;
    REQUIRE(ParseEnvelope(reply.envelope, &envelope).ok());
    handed_back.push_back({client, envelope.request_id()});
    return Status();
  }
};

}  // namespace b4mrl
