// Highway's steps: bare steps on one core against the C library's functions that they call, and
// steps through the daemon against bare steps on all cores, in steps a second and in processor
// time.
#include <fmt/format.h>

#include <functional>
#include <memory>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/highway_load.h"
#include "benchmarks/performance/support/parallel_rate.h"
#include "benchmarks/performance/support/processor_time.h"
#include "benchmarks/performance/support/step_loop.h"
#include "proto/base/clock.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {
namespace {

constexpr size_t kActionRows = 4096;
constexpr size_t kRecordedSteps = 2000;
constexpr double kBareTarget = 0.35;
// Processor time, in s, that a batch of 64 steps may take beyond that of its bare steps.
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

Status MeasureSocket(const Options& options, Transport transport, const std::string& name,
                     const HighwaySettings& settings, const std::vector<float>& actions,
                     Reporter& reporter) {
  const std::vector<int> cores = AvailableCores();
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon,
                         Daemon::Open(options, {.transport = transport, .pinned = true}));
  B4MRL_ASSIGN_OR_RETURN(StepLoop loop,
                         StepLoop::Open(daemon.client(), "Highway", {{"cars", "15"}}, 1));
  loop.UseActions(actions);
  // As many roads as the daemon has lanes, stepped in turn: one road alone would stay in the
  // first-level cache.
  const size_t roads = (StepLoop::kLanes + cores.size() - 1) / cores.size();
  const auto bare_rate = [&](size_t thread) -> std::function<void(size_t)> {
    auto bare = std::make_shared<std::vector<BareHighway>>();
    for (size_t road = 0; road < roads; ++road) bare->emplace_back(settings, thread * roads + road);
    return [=, &actions](size_t i) { (*bare)[i % roads].Step(Row(actions, i + thread * 17)); };
  };
  std::vector<double> batch_seconds;  // processor time of a batch, one number a turn
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns,
          [&]() -> Result<double> {
            const ScopedPin pin(cores.front());
            const double before = ProcessorSecondsWith(daemon.process_group());
            B4MRL_ASSIGN_OR_RETURN(const double rate, loop.Rate(options.seconds));
            const double spent = ProcessorSecondsWith(daemon.process_group()) - before;
            batch_seconds.push_back(spent / (rate * options.seconds / StepLoop::kLanes));
            return rate;
          },
          [&]() -> Result<double> { return RateOnAllCores(options.seconds, bare_rate); }));
  reporter.Report({name, medians.value, "1/s", medians.limit,
                   "bare steps, one pinned thread a core", 0, false});
  if (daemon.process_group() == 0) return Status();  // a daemon of --endpoint
  const double bare_batch = StepLoop::kLanes * static_cast<double>(cores.size()) / medians.limit;
  reporter.Report({name + "-cpu", 1e6 * Median(batch_seconds), "us", 1e6 * bare_batch,
                   "processor time of 64 bare steps", (bare_batch + kMaxBatchOverhead) / bare_batch,
                   true});
  return Status();
}

}  // namespace

Status MeasureHighway(const Options& options, Reporter& reporter) {
  const HighwaySettings settings = HighwayTask();
  const std::vector<float> actions = HighwayActions(kActionRows);
  B4MRL_RETURN_IF_ERROR(MeasureBare(options, settings, actions, reporter));
  B4MRL_RETURN_IF_ERROR(
      MeasureSocket(options, Transport::kTcp, "highway-socket", settings, actions, reporter));
  return MeasureSocket(options, Transport::kIpc, "highway-ipc", settings, actions, reporter);
}

}  // namespace b4mrl::perf
