// A cycle of a model-based learner: 1,000 updates of SAC, and rollouts of 250,000 steps under one
// policy. MOPO's rollouts evaluate all members of the ensemble, for the penalty; HyMOPO's, without
// a penalty, evaluate one member a row and query the daemon's simulator.
//
// With rollout-lag 1 the next rollouts are made during the updates on the last ones, with 0 before
// the updates. The limit of the cycle with lag 1 is the processor time of all processes, spread
// evenly over the cores: the time of a learner that never waits.
//
// The ensemble is untrained, and its standard deviations are so small that rows stay near the
// recorded states.
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/cores/sac_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/model/termination.h"
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
constexpr int kThreads = 2;  // the learners' default
constexpr int kObservation = kCheetahObservationSize;
constexpr int kAction = kCheetahActionSize;

SacOptions CoreOptions() {
  SacOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.batch_max = kBatch;
  options.threads = kThreads;
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

// As the learners have them by default. `termination`: given for MOPO, which has no simulator.
ModelRolloutOptions RolloutOptions(std::optional<Termination> termination) {
  ModelRolloutOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.horizon = kHorizon;
  options.action_scale.assign(kAction, 1.0f);
  if (termination) {
    options.penalty = 1;
    options.chunks_in_flight = 1;
  }
  options.termination = std::move(termination);
  return options;
}

// What tells the learners apart: HyMOPO has a simulator, MOPO a termination function.
struct ModelLearner {
  std::string name;
  std::optional<RemoteEnvironment> simulator;
  std::optional<Termination> termination;
};

class Cycle {
 public:
  Cycle(ModelLearner learner, SacCore<float> core, DynamicsEnsemble<float> ensemble,
        ReplayBuffer pool, const RecordedRows& recorded)
      : core_(std::move(core)),
        ensemble_(std::move(ensemble)),
        pool_(std::move(pool)),
        simulator_(std::move(learner.simulator)),
        rollout_(RolloutOptions(std::move(learner.termination)),
                 simulator_ ? &*simulator_ : nullptr, &ensemble_),
        batch_(kObservation, kAction, kBatch) {
    for (size_t i = 0; i < kStarts; ++i) {
      const float* row = &recorded.observations[i % recorded.rows() * kCheetahObservationSize];
      starts_.insert(starts_.end(), row, row + kCheetahObservationSize);
    }
  }

  // Makes the first rollouts, without updates beside them.
  Status Start() {
    B4MRL_RETURN_IF_ERROR(rollout_.Begin(0, starts_, core_.Policy()));
    return rollout_.Finish(pool_).status();
  }

  // One cycle with rollout-lag 1 or 0.
  Status Run(bool lag) {
    const uint64_t previous = pool_.length();
    B4MRL_RETURN_IF_ERROR(rollout_.Begin(++cycle_, starts_, core_.Policy()));
    if (lag) Update();
    B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, rollout_.Finish(pool_));
    pool_.DropBefore(previous);
    if (counts.rows < kStarts * kHorizon / 2) {
      return Status(StatusCode::kInternal, "most rows of a rollout came back invalid");
    }
    if (!lag) Update();
    return Status();
  }

 private:
  void Update() {
    for (int update = 0; update < kUpdates; ++update) {
      Rng rows(cycle_, "rows", static_cast<uint64_t>(update));
      pool_.Sample(rows, 0, kBatch, batch_);
      core_.Update(batch_.view());
    }
  }

  SacCore<float> core_;
  DynamicsEnsemble<float> ensemble_;
  ReplayBuffer pool_;
  std::optional<RemoteEnvironment> simulator_;
  ModelRollout rollout_;
  BatchBuffer batch_;
  std::vector<float> starts_;
  uint64_t cycle_ = 0;
};

// Reports NAME-cycle, the seconds of a cycle with rollout-lag 1, and NAME-cycle-lag-0, those
// without the lag.
Status MeasureLags(const Options& options, ModelLearner learner, const RecordedRows& recorded,
                   pid_t daemon, Reporter& reporter) {
  const std::string name = learner.name + "-cycle";
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(CoreOptions()));
  B4MRL_ASSIGN_OR_RETURN(auto ensemble, DynamicsEnsemble<float>::Create(ModelOptions(), kThreads));
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer pool,
                         ReplayBuffer::InMemory({.observation_size = kObservation,
                                                 .action_size = kAction,
                                                 .capacity = 3 * kStarts * kHorizon}));
  Cycle cycle(std::move(learner), std::move(core), std::move(ensemble), std::move(pool), recorded);
  B4MRL_RETURN_IF_ERROR(cycle.Start());
  std::vector<double> processor_seconds;  // of each cycle with the lag, over the cores
  const double cores = static_cast<double>(AvailableCores().size());
  const auto seconds = [&](bool lag) -> Result<double> {
    const double before = ProcessorSecondsWith(daemon);
    const Clock::time_point start = Clock::now();
    B4MRL_RETURN_IF_ERROR(cycle.Run(lag));
    const double taken = SecondsSince(start);
    if (lag) processor_seconds.push_back((ProcessorSecondsWith(daemon) - before) / cores);
    return taken;
  };
  B4MRL_ASSIGN_OR_RETURN(const Medians medians, MeasureInTurns(
                                                    options.turns, [&] { return seconds(true); },
                                                    [&] { return seconds(false); }));
  processor_seconds.erase(processor_seconds.begin());  // of the warm-up
  reporter.Report({name, medians.value, "s", Median(processor_seconds),
                   "all processor time of the same cycle over the cores", 1.15, true});
  reporter.Report({name + "-lag-0", medians.limit, "s", medians.value,
                   "the cycle with rollout-lag 1", 0, true});
  return Status();
}

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
  B4MRL_ASSIGN_OR_RETURN(Termination never, Termination::Of(simulator.spec()));
  B4MRL_RETURN_IF_ERROR(MeasureLags(options, {"hymopo", std::move(simulator), {}}, recorded,
                                    daemon.process_group(), reporter));
  return MeasureLags(options, {"mopo", {}, std::move(never)}, recorded, daemon.process_group(),
                     reporter);
}

}  // namespace b4mrl::perf
