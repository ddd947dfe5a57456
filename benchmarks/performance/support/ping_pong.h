// The limit for every request: a bare ZeroMQ DEALER-ROUTER round trip between two processes, with
// messages of given sizes whose content nobody computes or reads.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "proto/base/child_program.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

// Bytes of the two frames of a message; a payload of 0 bytes is not sent.
struct FrameSizes {
  size_t envelope = 0;
  size_t payload = 0;
};

// The asking side, in this process. One thread.
class PingPong {
 public:
  // Starts this program again as the process that answers on `address` ("tcp://127.0.0.1:*" or
  // "ipc://PATH"), and connects to it.
  static Result<std::unique_ptr<PingPong>> Start(const std::string& address, FrameSizes request,
                                                 FrameSizes reply);
  // Connects another asker to the process that `other` started; `other` outlives it.
  static Result<std::unique_ptr<PingPong>> Join(const PingPong& other);
  ~PingPong();

  // Microseconds of one round trip; kDeadlineExceeded if the process answers nothing for 10 s.
  Result<double> RoundTrip();

 private:
  PingPong(FrameSizes request, FrameSizes reply) : request_(request), reply_(reply) {}
  Status Spawn(const std::string& address);
  Status Connect(const std::string& address);

  FrameSizes request_;
  FrameSizes reply_;
  ProgramWithOutput server_;
  std::string endpoint_;
  void* context_ = nullptr;
  void* socket_ = nullptr;
};

// The main function of the answering process: binds, prints the endpoint as one line on stdout, and
// answers until it is killed or its parent ends. Returns, with an exit code, only when it cannot
// bind.
int RunPong(const std::string& address, FrameSizes reply);

}  // namespace b4mrl::perf
