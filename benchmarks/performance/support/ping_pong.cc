#include "benchmarks/performance/support/ping_pong.h"

#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>

#include <cstdio>
#include <cstring>
#include <vector>

#include "proto/base/clock.h"

namespace b4mrl::perf {
namespace {

constexpr int kTimeoutMs = 10'000;

bool SendFrame(void* socket, size_t size, bool more) {
  zmq_msg_t message;
  if (zmq_msg_init_size(&message, size) != 0) return false;
  std::memset(zmq_msg_data(&message), 1, size);
  if (zmq_msg_send(&message, socket, more ? ZMQ_SNDMORE : 0) >= 0) return true;
  zmq_msg_close(&message);
  return false;
}

bool SendFrames(void* socket, FrameSizes sizes) {
  const bool has_payload = sizes.payload > 0;
  return SendFrame(socket, sizes.envelope, has_payload) &&
         (!has_payload || SendFrame(socket, sizes.payload, false));
}

// Receives all parts of one message; false on a time-out.
bool ReceiveAll(void* socket) {
  bool more = true;
  while (more) {
    zmq_msg_t part;
    zmq_msg_init(&part);
    if (zmq_msg_recv(&part, socket, 0) < 0) return false;
    more = zmq_msg_more(&part) != 0;
    zmq_msg_close(&part);
  }
  return true;
}

void Answer(void* socket, FrameSizes reply) {
  zmq_msg_t id;
  zmq_msg_init(&id);
  if (zmq_msg_recv(&id, socket, 0) < 0) return;
  if (zmq_msg_more(&id)) ReceiveAll(socket);
  if (zmq_msg_send(&id, socket, ZMQ_SNDMORE) < 0) return;
  SendFrames(socket, reply);
}

}  // namespace

Result<std::unique_ptr<PingPong>> PingPong::Start(const std::string& address, FrameSizes request,
                                                  FrameSizes reply) {
  std::unique_ptr<PingPong> pair(new PingPong(request, reply));
  B4MRL_RETURN_IF_ERROR(pair->Spawn(address));
  B4MRL_RETURN_IF_ERROR(pair->Connect(pair->endpoint_));
  return pair;
}

Result<std::unique_ptr<PingPong>> PingPong::Join(const PingPong& other) {
  std::unique_ptr<PingPong> pair(new PingPong(other.request_, other.reply_));
  B4MRL_RETURN_IF_ERROR(pair->Connect(other.endpoint_));
  return pair;
}

Status PingPong::Spawn(const std::string& address) {
  const std::vector<std::string> words = {"b4mrl-perf", "pong", address,
                                          std::to_string(reply_.envelope),
                                          std::to_string(reply_.payload)};
  const int error = StartWithOutput("/proc/self/exe", words, &server_);
  if (error != 0) return IoError("start", "the bare server", error);
  char byte = 0;
  while (read(server_.output.get(), &byte, 1) == 1 && byte != '\n') endpoint_ += byte;
  if (byte != '\n') return Status(StatusCode::kUnavailable, "the bare server did not start");
  return Status();
}

Status PingPong::Connect(const std::string& address) {
  context_ = zmq_ctx_new();
  socket_ = zmq_socket(context_, ZMQ_DEALER);
  const int linger = 0;
  zmq_setsockopt(socket_, ZMQ_LINGER, &linger, sizeof(linger));
  zmq_setsockopt(socket_, ZMQ_RCVTIMEO, &kTimeoutMs, sizeof(kTimeoutMs));
  if (zmq_connect(socket_, address.c_str()) != 0) {
    return IoError("connect to", address, zmq_errno());
  }
  return Status();
}

PingPong::~PingPong() {
  if (socket_ != nullptr) zmq_close(socket_);
  if (context_ != nullptr) zmq_ctx_term(context_);
  if (server_.process_id > 0) {
    kill(server_.process_id, SIGTERM);
    waitpid(server_.process_id, nullptr, 0);
  }
}

Result<double> PingPong::RoundTrip() {
  const Clock::time_point start = Clock::now();
  if (!SendFrames(socket_, request_) || !ReceiveAll(socket_)) {
    return Status(StatusCode::kDeadlineExceeded, "the bare server does not answer");
  }
  return SecondsSince(start) * 1e6;
}

int RunPong(const std::string& address, FrameSizes reply) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  void* context = zmq_ctx_new();
  void* socket = zmq_socket(context, ZMQ_ROUTER);
  if (zmq_bind(socket, address.c_str()) != 0) {
    fmt::print(stderr, "cannot bind {}: {}\n", address, zmq_strerror(zmq_errno()));
    return 3;
  }
  char endpoint[256];
  size_t length = sizeof(endpoint);
  zmq_getsockopt(socket, ZMQ_LAST_ENDPOINT, endpoint, &length);
  fmt::print("{}\n", endpoint);
  std::fflush(stdout);
  while (true) Answer(socket, reply);
}

}  // namespace b4mrl::perf
