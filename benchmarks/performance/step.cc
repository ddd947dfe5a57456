// Steps a second of 64 lanes through the daemon, driven by one client thread that keeps several
// requests in flight, against bare mj_step on all cores.
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/bare_physics.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/step_loop.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {
namespace {

constexpr size_t kActionRows = 4096;

Status MeasureTask(const Options& options, const PhysicsTask& task, Reporter& reporter) {
  // The bare limit runs on pinned threads, so the daemon and client are pinned as well.
  const int core = AvailableCores().front();
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.pinned = true}));
  B4MRL_ASSIGN_OR_RETURN(StepLoop loop, StepLoop::Open(daemon.client(), task.environment));
  B4MRL_ASSIGN_OR_RETURN(const auto bare, BarePhysics::Load(task));
  const std::vector<float> random =
      RandomActions(kActionRows, loop.action_size(), task.action_bound);
  const std::vector<double> actions = AsDoubles(random);
  loop.UseActions(random);
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns,
          [&] {
            const ScopedPin pin(core);
            return loop.Rate(options.seconds);
          },
          [&]() -> Result<double> { return bare->StepRate(actions, options.seconds); }));
  const double target = task.environment == "HalfCheetah" ? 0.90 : 0.85;
  reporter.Report({"step-" + task.environment, medians.value, "1/s", medians.limit,
                   "bare mj_step, one pinned thread a core", target, false});
  return Status();
}

}  // namespace

Status MeasureStep(const Options& options, Reporter& reporter) {
  for (const PhysicsTask& task : PhysicsTasks()) {
    B4MRL_RETURN_IF_ERROR(MeasureTask(options, task, reporter));
  }
  return Status();
}

}  // namespace b4mrl::perf
