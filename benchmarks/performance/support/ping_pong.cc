#include "benchmarks/performance/support/ping_pong.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include "proto/base/clock.h"

extern char** environ;

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

Status PingPong::Spawn(const std::string& address) {
  int out[2];
  if (pipe2(out, O_CLOEXEC) != 0) return IoError("make", "a pipe", errno);
  from_process_ = out[0];
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
  std::vector<std::string> words = {"b4mrl-perf", "pong", address, std::to_string(reply_.envelope),
                                    std::to_string(reply_.payload)};
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const int error =
      posix_spawn(&process_, "/proc/self/exe", &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(out[1]);
  if (error != 0) return IoError("start", "the bare server", error);
  char byte = 0;
  while (read(from_process_, &byte, 1) == 1 && byte != '\n') endpoint_ += byte;
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
  if (process_ > 0) {
    kill(process_, SIGTERM);
    waitpid(process_, nullptr, 0);
  }
  if (from_process_ >= 0) close(from_process_);
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
  signal(SIGINT, SIG_IGN);  // a terminal's Ctrl-C is for the measuring process
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
