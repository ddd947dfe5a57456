// Hooks for a FakeDaemon that lets learners train. For tests.
#pragma once

#include <algorithm>

#include "client/remote_environment.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {

// Every step of every lane ends its episode with this cause.
class EndsEveryStep {
 public:
  explicit EndsEveryStep(Cause cause) : cause_(cause) {}

  bool operator()(FakeServer& server, FakeCall& call) const {
    if (!call.request.has_step()) return false;
    const size_t rows = Elements<uint64_t>(call, "numbers").size();
    pb::Reply reply;
    ArrayLayout layout(reply.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {rows, kObservationSize});
    layout.Add("rewards", DType::kFloat64, {rows});
    layout.Add("terminated", DType::kUint8, {rows});
    const size_t truncated = layout.Add("truncated", DType::kUint8, {rows});
    const size_t causes = layout.Add("cause", DType::kUint8, {rows});
    Frame payload = layout.Allocate();
    std::fill_n(payload.data(), payload.size(), std::byte{0});
    std::ranges::fill(ArrayAt<uint8_t>(payload, truncated, rows), uint8_t{1});
    std::ranges::fill(ArrayAt<uint8_t>(payload, causes, rows), static_cast<uint8_t>(cause_));
    server.Reply(call, std::move(reply), std::move(payload));
    return true;
  }

 private:
  Cause cause_;
};

}  // namespace b4mrl
