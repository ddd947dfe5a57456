// A connection and the server that it talks to, which does what a test says.
#pragma once

#include <catch2/catch.hpp>
#include <memory>
#include <string>

#include "client/connection.h"
#include "tests/client/fake_server.h"

namespace b4mrl {

inline constexpr int64_t kPatientMs = 600'000;  // an eighth is longer than FakeServer::Take waits

class ConnectionFixture {
 public:
  ConnectionFixture() : server_(std::make_unique<FakeServer>(folder_.Address())) {
    Result<Connection> connection =
        Connection::Open(context_, folder_.Address(), "0123456789abcdef");
    REQUIRE(connection.ok());
    connection_ = std::make_unique<Connection>(std::move(*connection));
  }

  FakeServer& server() { return *server_; }
  Connection& connection() { return *connection_; }
  const SocketFolder& folder() const { return folder_; }
  void KillServer() { server_.reset(); }

  Result<uint64_t> TrySend(const std::string& text, int64_t deadline_ms = kPatientMs,
                           Frame payload = {}) {
    pb::Request request;
    request.mutable_hello()->set_client(text);
    return connection_->Send(std::move(request), std::move(payload),
                             Deadline::AfterMs(deadline_ms));
  }
  uint64_t Send(const std::string& text, int64_t deadline_ms = kPatientMs, Frame payload = {}) {
    const Result<uint64_t> id = TrySend(text, deadline_ms, std::move(payload));
    REQUIRE(id.ok());
    return *id;
  }
  FakeCall Take() {
    std::optional<FakeCall> call = server_->Take();
    REQUIRE(call.has_value());
    return std::move(*call);
  }
  std::string ReceiveText(uint64_t id) {
    Result<ReceivedReply> reply = connection_->Receive(id);
    INFO(reply.status().ToString());
    REQUIRE(reply.ok());
    return reply->envelope.hello().server_version();
  }

 private:
  SocketFolder folder_;
  Context context_;
  std::unique_ptr<FakeServer> server_;
  std::unique_ptr<Connection> connection_;
};

// The bytes that must not differ between two copies of a request.
inline std::string WithoutDeadline(const FakeCall& call) {
  pb::Request request = call.request;
  request.clear_deadline_ms();
  return request.SerializeAsString() + std::string(call.payload.view());
}

}  // namespace b4mrl
