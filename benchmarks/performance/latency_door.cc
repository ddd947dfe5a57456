// One step of one lane through shared memory, against a bare step and against the step over ipc.
//
// What a step costs beyond its physics is its latency minus the time that the worker reports for
// simulating. On a shared machine most steps are disturbed, so it is measured in windows of 12
// steps, and the best quarter of the windows counts.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/bare_physics.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/single_lane.h"
#include "proto/base/clock.h"

namespace b4mrl::perf {
namespace {

constexpr int kStepsPerTurn = 1200;
constexpr int kStepsPerWindow = 12;
constexpr int kBestShare = 4;  // a quarter of the windows
constexpr size_t kActionRows = 4096;
// What the client does between two steps: nothing, a small policy's work, a large one's.
constexpr std::chrono::microseconds kThinkTimes[] = {
    std::chrono::microseconds(0), std::chrono::microseconds(50), std::chrono::microseconds(1000)};

void Think(std::chrono::microseconds time) {
  const Clock::time_point end = Clock::now() + time;
  while (Clock::now() < end) {
  }
}

// Microseconds of a step beyond its physics, while the client thinks between two steps.
Result<double> CostBesidePhysics(SingleLane& lane, std::chrono::microseconds think) {
  std::vector<double> windows;
  while (windows.size() < kStepsPerTurn / kStepsPerWindow) {
    std::vector<double> window;
    for (int i = 0; i < kStepsPerWindow; ++i) {
      Think(think);
      const Clock::time_point start = Clock::now();
      B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, lane.Step());
      window.push_back(SecondsSince(start) * 1e6 - outcome.reply.envelope.timing().simulating_us());
    }
    windows.push_back(Median(std::move(window)));
  }
  std::sort(windows.begin(), windows.end());
  windows.resize(windows.size() / kBestShare);
  return Median(std::move(windows));
}

double MedianBareStep(const std::function<void()>& step) {
  std::vector<double> times;
  for (int i = 0; i < kStepsPerTurn; ++i) {
    const Clock::time_point start = Clock::now();
    step();
    times.push_back(SecondsSince(start) * 1e6);
  }
  return Median(std::move(times));
}

}  // namespace

Status MeasureLatencyOfDoor(const Options& options, Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(Daemon with_door, Daemon::Open(options, {.transport = Transport::kDoor}));
  B4MRL_ASSIGN_OR_RETURN(Daemon with_ipc, Daemon::Open(options, {.transport = Transport::kIpc}));
  B4MRL_ASSIGN_OR_RETURN(SingleLane door, SingleLane::Open(with_door.client()));
  B4MRL_ASSIGN_OR_RETURN(SingleLane ipc, SingleLane::Open(with_ipc.client()));
  B4MRL_ASSIGN_OR_RETURN(const auto physics, BarePhysics::Load(HalfCheetahTask()));
  const std::vector<double> bare_actions = AsDoubles(RandomActions(kActionRows));
  const std::function<void()> bare_step = physics->Stepper(bare_actions);
  B4MRL_ASSIGN_OR_RETURN(const Medians step,
                         MeasureInTurns(
                             2 * options.turns, [&] { return door.MedianStepTime(kStepsPerTurn); },
                             [&]() -> Result<double> { return MedianBareStep(bare_step); }));
  reporter.Report({"latency-door", step.value, "us", step.limit, "a bare step, p50", 0, true});
  for (const std::chrono::microseconds think : kThinkTimes) {
    B4MRL_ASSIGN_OR_RETURN(const Medians cost,
                           MeasureInTurns(
                               2 * options.turns, [&] { return CostBesidePhysics(door, think); },
                               [&] { return CostBesidePhysics(ipc, think); }));
    reporter.Report({fmt::format("latency-door-think-{}", think.count()), cost.value, "us",
                     cost.limit, "the same over ipc", 0, true});
  }
  return Status();
}

}  // namespace b4mrl::perf
