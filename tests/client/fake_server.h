// A server for tests of the client: a ROUTER whose answers the test decides.
#pragma once

#include <atomic>
#include <catch2/catch.hpp>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <thread>

#include "proto/b4mrl.pb.h"
#include "proto/base/limits.h"
#include "proto/wire/frame.h"
#include "proto/wire/socket.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

// A folder of its own, and socket addresses in it.
class SocketFolder : public TemporaryFolder {
 public:
  std::string Address(const std::string& name = "server") const { return "ipc://" + File(name); }
};

struct FakeCall {
  RoutingId sender;
  pb::Request request;
  Frame payload;
};

inline Message MakeReply(uint64_t request_id, pb::Reply reply, Frame payload) {
  reply.set_protocol_version(limits::kProtocolVersion);
  reply.set_request_id(request_id);
  return {std::move(*SerializeEnvelope(reply)), std::move(payload)};
}

// Belongs to the thread that makes it.
class FakeServer {
 public:
  explicit FakeServer(const std::string& address) : socket_(Bind(context_, address)) {}

  // The next request, if one comes in time.
  std::optional<FakeCall> Take(int64_t timeout_ms = 10'000) {
    void* const socket = socket_.handle();
    if (!WaitAnyReadable({&socket, 1}, timeout_ms)) return std::nullopt;
    std::optional<IncomingMessage> incoming = socket_.TryReceive();
    if (!incoming) return std::nullopt;
    FakeCall call{incoming->sender, {}, std::move(incoming->message.payload)};
    if (!ParseEnvelope(incoming->message.envelope, &call.request).ok()) return std::nullopt;
    return call;
  }
  void Reply(const FakeCall& call, pb::Reply reply = {}, Frame payload = {}) {
    Send(call, MakeReply(call.request.request_id(), std::move(reply), std::move(payload)));
  }
  void ReplyError(const FakeCall& call, const Status& status) {
    pb::Reply reply;
    SetStatus(status, reply.mutable_status());
    Reply(call, std::move(reply));
  }
  // A reply that can be told apart: a Hello with the text that the request carried.
  void Echo(const FakeCall& call) {
    pb::Reply reply;
    reply.mutable_hello()->set_server_version(call.request.hello().client());
    Reply(call, std::move(reply));
  }
  void Send(const FakeCall& call, Message message) {
    (void)socket_.Send(call.sender, std::move(message));
  }

 private:
  static RouterSocket Bind(Context& context, const std::string& address) {
    const ListeningEndpoint endpoint{address};
    return std::move(*RouterSocket::Bind(context, std::span(&endpoint, 1)));
  }

  Context context_;
  RouterSocket socket_;
};

// A fake server on a thread of its own: every request goes to `answer`, which runs there.
class FakeServerThread {
 public:
  using Answer = std::function<void(FakeServer&, FakeCall&)>;

  FakeServerThread(const std::string& address, Answer answer) {
    std::promise<void> bound;
    std::future<void> is_bound = bound.get_future();
    thread_ = std::thread([this, address, answer = std::move(answer), &bound] {
      FakeServer server(address);
      bound.set_value();
      while (!stop_) {
        if (std::optional<FakeCall> call = server.Take(10)) answer(server, *call);
      }
    });
    is_bound.wait();
  }
  ~FakeServerThread() {
    stop_ = true;
    thread_.join();
  }
  FakeServerThread(const FakeServerThread&) = delete;
  FakeServerThread& operator=(const FakeServerThread&) = delete;

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace b4mrl
