// Hooks for a FakeDaemon that lets learners train. For tests.
#pragma once

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

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

// Every second row of a query, from the row after its first one, reaches an observation that ends
// an episode. All rows stay where they are.
inline bool EndOddRows(FakeServer& server, const FakeCall& call) {
  if (!call.request.has_query()) return false;
  const std::vector<float> observations = Elements<float>(call, "observations");
  const size_t rows = observations.size() / kObservationSize;
  pb::Reply reply;
  ArrayLayout layout(reply.mutable_arrays());
  const size_t next = layout.Add("next_observations", DType::kFloat32, {rows, kObservationSize});
  const size_t rewards = layout.Add("rewards", DType::kFloat64, {rows});
  const size_t terminated = layout.Add("terminated", DType::kUint8, {rows});
  const size_t valid = layout.Add("valid", DType::kUint8, {rows});
  Frame payload = layout.Allocate();
  std::ranges::copy(observations, ArrayAt<float>(payload, next, observations.size()).begin());
  std::ranges::fill(ArrayAt<double>(payload, rewards, rows), 0.0);
  std::ranges::fill(ArrayAt<uint8_t>(payload, valid, rows), uint8_t{1});
  const std::span<uint8_t> ends = ArrayAt<uint8_t>(payload, terminated, rows);
  for (size_t row = 0; row < rows; ++row) ends[row] = row % 2 == 0 ? 0 : 1;
  server.Reply(call, std::move(reply), std::move(payload));
  return true;
}

}  // namespace b4mrl
