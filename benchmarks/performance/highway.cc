// Highway's steps: bare on one core against the C library's functions that they call, and through
// the daemon against bare steps on all cores.
#include <fmt/format.h>

#include <functional>
#include <memory>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/daemon.h"
#include "benchmarks/performance/highway_load.h"
#include "benchmarks/performance/parallel_rate.h"
#include "benchmarks/performance/step_loop.h"
#include "proto/base/clock.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {
namespace {

constexpr size_t kActionRows = 4096;
constexpr size_t kRecordedSteps = 2000;
constexpr double kBareTarget = 0.35;
// What a batch may cost beyond its bare steps, in seconds of processor time.
constexpr double kMaxBatchOverhead = 200e-6;

// Steps a second of `step` on this thread.
double RateOnThisCore(double seconds, const std::function<void(size_t)>& step) {
  const Clock::time_point start = Clock::now();
  size_t count = 0;
  while (SecondsSince(start) < seconds) {
    for (int i = 0; i < 100; ++i) step(count++);
  }
  return static_cast<double>(count) / SecondsSince(start);
}

std::span<const float> Row(const std::vector<float>& actions, size_t row) {
  return std::span(actions).subspan(row % kActionRows * kHighwayActionSize, kHighwayActionSize);
}

Status MeasureBare(const Options& options, const HighwaySettings& settings,
                   const std::vector<float>& actions, Reporter& reporter) {
  const ScopedPin pin(AvailableCores().front());
  BareHighway bare(settings, 0);
  const LibraryCalls calls(settings, actions, kRecordedSteps);
  double sink = 0;
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns,
          [&]() -> Result<double> {
            return RateOnThisCore(options.seconds, [&](size_t i) { bare.Step(Row(actions, i)); });
          },
          [&]() -> Result<double> {
            const Clock::time_point start = Clock::now();
            size_t rounds = 0;
            for (; SecondsSince(start) < options.seconds; ++rounds) sink += calls.Repeat();
            return static_cast<double>(rounds * calls.steps()) / SecondsSince(start);
          }));
  if (!(sink == sink)) return Status(StatusCode::kInternal, "a recorded call gives no number");
  reporter.Report({"highway-bare", medians.value, "1/s", medians.limit,
                   fmt::format("the {:.0f} calls of the C library in a step, one core",
                               static_cast<double>(calls.size()) / calls.steps()),
                   kBareTarget, false});
  return Status();
}

Status MeasureSocket(const Options& options, const HighwaySettings& settings,
                     const std::vector<float>& actions, Reporter& reporter) {
  const std::vector<int> cores = AvailableCores();
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.pinned = true}));
  B4MRL_ASSIGN_OR_RETURN(StepLoop loop,
                         StepLoop::Open(daemon.client(), "Highway", {{"cars", "15"}}, 1));
  loop.UseActions(actions);
  const auto bare_rate = [&](size_t thread) -> std::function<void(size_t)> {
    auto bare = std::make_shared<BareHighway>(settings, thread);
    return [=, &actions](size_t i) { bare->Step(Row(actions, i + thread * 17)); };
  };
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns,
          [&] {
            const ScopedPin pin(cores.front());
            return loop.Rate(options.seconds);
          },
          [&]() -> Result<double> { return RateOnAllCores(options.seconds, bare_rate); }));
  // The allowance as a ratio of rates.
  const double bare_batch = StepLoop::kLanes * static_cast<double>(cores.size()) / medians.limit;
  reporter.Report({"highway-socket", medians.value, "1/s", medians.limit,
                   "bare steps, one pinned thread a core",
                   bare_batch / (bare_batch + kMaxBatchOverhead), false});
  return Status();
}

}  // namespace

Status MeasureHighway(const Options& options, Reporter& reporter) {
  const HighwaySettings settings = HighwayTask();
  const std::vector<float> actions = HighwayActions(kActionRows);
  B4MRL_RETURN_IF_ERROR(MeasureBare(options, settings, actions, reporter));
  return MeasureSocket(options, settings, actions, reporter);
}

}  // namespace b4mrl::perf
