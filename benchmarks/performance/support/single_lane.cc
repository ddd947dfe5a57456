#include "benchmarks/performance/support/single_lane.h"

#include <span>
#include <utility>

#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/measurement.h"
#include "proto/base/clock.h"

namespace b4mrl::perf {
namespace {

constexpr size_t kActionRows = 4096;

}  // namespace

Result<SingleLane> SingleLane::Open(Client& client) {
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment, client.Make("HalfCheetah", {.seed = 0}));
  B4MRL_RETURN_IF_ERROR(environment.Reset().status());
  return SingleLane(std::move(environment), RandomActions(kActionRows));
}

Result<StepOutcome> SingleLane::Step() {
  const size_t row = next_row_++ % kActionRows;
  return environment_.Step(
      std::span<const float>(&actions_[row * kCheetahActionSize], kCheetahActionSize));
}

Result<std::vector<double>> SingleLane::StepTimes(int steps) {
  std::vector<double> times;
  times.reserve(steps);
  for (int i = 0; i < steps; ++i) {
    const Clock::time_point start = Clock::now();
    B4MRL_RETURN_IF_ERROR(Step().status());
    times.push_back(SecondsSince(start) * 1e6);
  }
  return times;
}

Result<double> SingleLane::MedianStepTime(int steps) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<double> times, StepTimes(steps));
  return Median(std::move(times));
}

}  // namespace b4mrl::perf
