// Steps a second of 64 lanes through the daemon, driven by one client thread that keeps several
// requests in flight, against bare mj_step on all cores.
#include <numeric>
#include <unordered_map>
#include <vector>

#include "benchmarks/performance/bare_physics.h"
#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/daemon.h"
#include "proto/base/clock.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {
namespace {

constexpr uint32_t kLanes = 64;
constexpr uint32_t kGroups = 2;  // requests in flight
constexpr uint32_t kLanesPerGroup = kLanes / kGroups;
constexpr size_t kActionRows = 4096;

class StepLoop {
 public:
  static Result<StepLoop> Open(Client& client) {
    EnvironmentOptions options;
    options.num_envs = kLanes;
    options.seed = 0;
    B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment, client.Make("HalfCheetah", options));
    B4MRL_RETURN_IF_ERROR(environment.Reset().status());
    return StepLoop(std::move(environment));
  }

  // Lane steps a second over about `seconds`.
  Result<double> Rate(double seconds) {
    const Clock::time_point start = Clock::now();
    for (uint32_t group = 0; group < kGroups; ++group) B4MRL_RETURN_IF_ERROR(Send(group));
    uint64_t steps = 0;
    double elapsed = 0;
    while (environment_.in_flight() > 0) {
      B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, environment_.Receive());
      const auto entry = group_of_.find(outcome.request_id);
      const uint32_t group = entry->second;
      group_of_.erase(entry);
      steps += kLanesPerGroup;
      elapsed = SecondsSince(start);
      if (elapsed < seconds) B4MRL_RETURN_IF_ERROR(Send(group));
    }
    return static_cast<double>(steps) / elapsed;
  }

 private:
  explicit StepLoop(RemoteEnvironment environment)
      : environment_(std::move(environment)), actions_(RandomActions(kActionRows)), lanes_(kLanes) {
    std::iota(lanes_.begin(), lanes_.end(), 0u);
  }

  Status Send(uint32_t group) {
    const std::span<const uint32_t> lanes(&lanes_[group * kLanesPerGroup], kLanesPerGroup);
    const std::span<const float> actions(&actions_[next_row_ * kCheetahActionSize],
                                         kLanesPerGroup * kCheetahActionSize);
    next_row_ = (next_row_ + kLanesPerGroup) % kActionRows;
    B4MRL_ASSIGN_OR_RETURN(const uint64_t id, environment_.Send(actions, lanes));
    group_of_[id] = group;
    return Status();
  }

  RemoteEnvironment environment_;
  std::vector<float> actions_;
  std::vector<uint32_t> lanes_;
  std::unordered_map<uint64_t, uint32_t> group_of_;
  size_t next_row_ = 0;
};

}  // namespace

Status MeasureStep(const Options& options, Reporter& reporter) {
  // The limit is pinned, so this is as well.
  const int core = AvailableCores().front();
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.pinned = true}));
  B4MRL_ASSIGN_OR_RETURN(StepLoop loop, StepLoop::Open(daemon.client()));
  B4MRL_ASSIGN_OR_RETURN(const auto bare, BarePhysics::Load(HalfCheetahTask()));
  const std::vector<double> actions = AsDoubles(RandomActions(kActionRows));
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns,
          [&] {
            const ScopedPin pin(core);
            return loop.Rate(options.seconds);
          },
          [&]() -> Result<double> { return bare->StepRate(actions, options.seconds); }));
  reporter.Report({"step-HalfCheetah", medians.value, "1/s", medians.limit,
                   "bare mj_step, one pinned thread a core", 0.90, false});
  return Status();
}

}  // namespace b4mrl::perf
