// A cycle of a model-based learner: 1,000 updates of SAC, and rollouts of 250,000 steps under one
// policy. MOPO's rollouts evaluate all members of the ensemble, for the penalty; HyMOPO's, without
// a penalty, evaluate one member a row and query the daemon's simulator.
//
// With rollout-lag 1 the next rollouts are made during the updates on the last ones, with 0 before
// the updates. The limit of the cycle with lag 1 is the processor time of all processes, spread
// evenly over the cores: the time of a learner that never waits. In bf16 the limit is the cycle in
// fp32.
//
// The ensemble is untrained, and its standard deviations are so small that rows stay near the
// recorded states.
#include <memory>
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

SacOptions CoreOptions(Precision precision) {
  SacOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.batch_max = kBatch;
  options.threads = kThreads;
  options.precision = precision;
  return options;
}

DynamicsEnsembleOptions ModelOptions(Precision precision) {
  DynamicsEnsembleOptions options;
  options.observation_size = kObservation;
  options.action_size = kAction;
  options.max_log_var = -9;
  options.min_log_var = -10;
  options.precision = precision;
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
  RemoteEnvironment* simulator;
  std::optional<Termination> termination;
};

class Cycle {
 public:
  Cycle(const ModelLearner& learner, SacCore<float> core, DynamicsEnsemble<float> ensemble,
        ReplayBuffer pool, const RecordedRows& recorded)
      : core_(std::move(core)),
        ensemble_(std::move(ensemble)),
        pool_(std::move(pool)),
        rollout_(RolloutOptions(learner.termination), learner.simulator, &ensemble_),
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
  ModelRollout rollout_;
  BatchBuffer batch_;
  std::vector<float> starts_;
  uint64_t cycle_ = 0;
};

Result<std::unique_ptr<Cycle>> MakeCycle(const ModelLearner& learner, Precision precision,
                                         const RecordedRows& recorded) {
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(CoreOptions(precision)));
  B4MRL_ASSIGN_OR_RETURN(auto ensemble,
                         DynamicsEnsemble<float>::Create(ModelOptions(precision), kThreads));
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer pool,
                         ReplayBuffer::InMemory({.observation_size = kObservation,
                                                 .action_size = kAction,
                                                 .capacity = 3 * kStarts * kHorizon}));
  auto cycle = std::make_unique<Cycle>(learner, std::move(core), std::move(ensemble),
                                       std::move(pool), recorded);
  B4MRL_RETURN_IF_ERROR(cycle->Start());
  return cycle;
}

Result<double> SecondsOf(Cycle& cycle, bool lag) {
  const Clock::time_point start = Clock::now();
  B4MRL_RETURN_IF_ERROR(cycle.Run(lag));
  return SecondsSince(start);
}

// Reports NAME-cycle, the seconds of a cycle with rollout-lag 1, and NAME-cycle-lag-0, those
// without the lag.
Status MeasureLags(const Options& options, const std::string& name, Cycle& cycle, pid_t daemon,
                   Reporter& reporter) {
  std::vector<double> processor_seconds;  // of each cycle with the lag, over the cores
  const double cores = static_cast<double>(AvailableCores().size());
  const auto seconds = [&](bool lag) -> Result<double> {
    const double before = ProcessorSecondsWith(daemon);
    B4MRL_ASSIGN_OR_RETURN(const double taken, SecondsOf(cycle, lag));
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

// Reports a learner's cycles in fp32 and, where the processor can, with rollout-lag 1 in bf16.
Status MeasureLearner(const Options& options, const ModelLearner& learner,
                      const RecordedRows& recorded, pid_t daemon, Reporter& reporter) {
  const std::string name = learner.name + "-cycle";
  B4MRL_ASSIGN_OR_RETURN(const auto fp32, MakeCycle(learner, Precision::kFp32, recorded));
  B4MRL_RETURN_IF_ERROR(MeasureLags(options, name, *fp32, daemon, reporter));
  if (!HasBf16()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const auto bf16, MakeCycle(learner, Precision::kBf16, recorded));
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(
                             options.turns, [&] { return SecondsOf(*bf16, /*lag=*/true); },
                             [&] { return SecondsOf(*fp32, /*lag=*/true); }));
  reporter.Report(
      {name + "-bf16", medians.value, "s", medians.limit, "the cycle in fp32", 0.85, true});
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
  B4MRL_RETURN_IF_ERROR(MeasureLearner(options, {"hymopo", &simulator, {}}, recorded,
                                       daemon.process_group(), reporter));
  return MeasureLearner(options, {"mopo", nullptr, std::move(never)}, recorded,
                        daemon.process_group(), reporter);
}

}  // namespace b4mrl::perf
