// HyMOPO's cycle as its learner runs it with rollout-lag 1: 1,000 updates of SAC on the rows of the
// last rollout, while the 250,000 queries of the next rollout are simulated. The limit is the
// processor time of all processes, spread evenly over the cores: the time of a learner that never
// waits.
//
// The ensemble is untrained, and its standard deviations are so small that rows stay near the
// recorded states.
#include <vector>

#include "algorithms/cores/sac_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/nn/products/blas.h"
#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/processor_time.h"
#include "benchmarks/performance/support/recorded_rows.h"
#include "proto/base/clock.h"
#include "proto/base/cores.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

constexpr int kUpdates = 1'000;
constexpr size_t kStarts = 50'000;
constexpr int kHorizon = 5;
constexpr int kBatch = 256;
constexpr int kObservation = kCheetahObservationSize;
constexpr int kAction = kCheetahActionSize;

SacOptions CoreOptions() {
  SacOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.batch_max = kBatch;
  return options;
}

DynamicsEnsembleOptions ModelOptions() {
  DynamicsEnsembleOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.max_log_var = -9;
  options.min_log_var = -10;
  return options;
}

ModelRolloutOptions RolloutOptions() {
  ModelRolloutOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.horizon = kHorizon;
  options.action_scale.assign(kAction, 1.0f);
  return options;
}

class Cycle {
 public:
  Cycle(SacCore<float> core, DynamicsEnsemble<float> ensemble, ReplayBuffer pool,
        RemoteEnvironment simulator, const RecordedRows& recorded)
      : core_(std::move(core)),
        ensemble_(std::move(ensemble)),
        pool_(std::move(pool)),
        simulator_(std::move(simulator)),
        rollout_(RolloutOptions(), &simulator_, &ensemble_),
        batch_(kObservation, kAction, kBatch) {
    for (size_t i = 0; i < kStarts; ++i) {
      const float* row = &recorded.observations[i % recorded.rows() * kCheetahObservationSize];
      starts_.insert(starts_.end(), row, row + kCheetahObservationSize);
    }
  }

  // Makes the first rollout, without updates beside it.
  Status Start() {
    B4MRL_RETURN_IF_ERROR(rollout_.Begin(0, starts_, core_.Policy()));
    return rollout_.Finish(pool_).status();
  }

  Status Run() {
    const uint64_t previous = pool_.length();
    B4MRL_RETURN_IF_ERROR(rollout_.Begin(++cycle_, starts_, core_.Policy()));
    for (int update = 0; update < kUpdates; ++update) {
      Rng rows(cycle_, "rows", static_cast<uint64_t>(update));
      pool_.Sample(rows, 0, kBatch, batch_);
      core_.Update(batch_.view());
    }
    B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, rollout_.Finish(pool_));
    pool_.DropBefore(previous);
    if (counts.rows < kStarts * kHorizon / 2) {
      return Status(StatusCode::kInternal, "most rows of a rollout came back invalid");
    }
    return Status();
  }

 private:
  SacCore<float> core_;
  DynamicsEnsemble<float> ensemble_;
  ReplayBuffer pool_;
  RemoteEnvironment simulator_;
  ModelRollout rollout_;
  BatchBuffer batch_;
  std::vector<float> starts_;
  uint64_t cycle_ = 0;
};

}  // namespace

Status MeasureCycle(const Options& options, Reporter& reporter) {
  UseOneBlasThread();
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.transport = Transport::kIpc,
                                                               .niceness = kDaemonGivesWay}));
  B4MRL_ASSIGN_OR_RETURN(const RecordedRows recorded, RecordRows(daemon.client(), options));
  EnvironmentOptions queries_alone;
  queries_alone.num_envs = 0;
  queries_alone.simulator = {{"gravity", ""}};
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment simulator,
                         daemon.client().Make("HalfCheetah", queries_alone));
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(CoreOptions()));
  B4MRL_ASSIGN_OR_RETURN(auto ensemble, DynamicsEnsemble<float>::Create(ModelOptions()));
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer pool,
                         ReplayBuffer::InMemory({.observation_size = kObservation,
                                                 .action_size = kAction,
                                                 .capacity = 3 * kStarts * kHorizon}));
  Cycle cycle(std::move(core), std::move(ensemble), std::move(pool), std::move(simulator),
              recorded);
  B4MRL_RETURN_IF_ERROR(cycle.Start());
  // One run gives both numbers: the limit is the processor time of the same run.
  double processor_seconds = 0;
  const double cores = static_cast<double>(AvailableCores().size());
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(
                             options.turns,
                             [&]() -> Result<double> {
                               const double before = ProcessorSecondsWith(daemon.process_group());
                               const Clock::time_point start = Clock::now();
                               B4MRL_RETURN_IF_ERROR(cycle.Run());
                               const double seconds = SecondsSince(start);
                               processor_seconds =
                                   ProcessorSecondsWith(daemon.process_group()) - before;
                               return seconds;
                             },
                             [&]() -> Result<double> { return processor_seconds / cores; }));
  reporter.Report({"hymopo-cycle", medians.value, "s", medians.limit,
                   "all processor time of the same cycle over the cores", 1.15, true});
  return Status();
}

}  // namespace b4mrl::perf
