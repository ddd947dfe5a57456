// HyMOPO: hybrid model-based policy optimisation (the B4MRL paper's algorithm 1, on MOPO's
// hyperparameters as run there).
//
//   D        dataset of (o, a, r, o', d)          T_sim    the imperfect simulator, asked by Query
//   f        ensemble of Gaussian correction networks (o, a) -> (delta, r)
//   D_model  what rollouts in the corrected simulator produced lately
//   pi       SAC's policy (rl/sac_core.h)
//
//   pre-pass:  o'_sim <- T_sim(o, a) for every row of D           (rl/correction_data.h)
//   train f on targets [o' - o'_sim, r] by likelihood             (rl/dynamics_ensemble.h)
//   repeat:    every `rollout-every` updates: `rollout-rows` starts from D, `horizon` steps of
//              o' = o'_sim + delta under pi; add to D_model        (rl/model_rollout.h)
//              one SAC update on a batch, `real-ratio` of it from D, the rest from D_model
//
// D_model keeps the rollouts of the last `model-retain` cycles. They are a function of the policies
// that made them, so a checkpoint keeps those policies, and resuming rolls them out again. With
// rollout-lag 1 a cycle uses the rollouts of the policy one cycle ago, which the daemon simulates
// while this process updates; with 0 it waits for the present policy's.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>
#include <utility>

#include "algorithms/learners/learners.h"
#include "algorithms/rl/batch_buffer.h"
#include "algorithms/rl/core_metrics.h"
#include "algorithms/rl/core_options.h"
#include "algorithms/rl/dynamics_ensemble.h"
#include "algorithms/rl/hidden_dimensions.h"
#include "algorithms/rl/model_data.h"
#include "algorithms/rl/model_rollout.h"
#include "algorithms/rl/policy_numbers.h"
#include "algorithms/rl/replay_buffer.h"
#include "algorithms/rl/sac_core.h"
#include "algorithms/rl/training_dataset.h"
#include "client/client.h"
#include "client/remote_dataset.h"
#include "client/remote_environment.h"

namespace b4mrl {
namespace {

constexpr Hyperparameter kHyperparameters[] = {
    {"penalty", 0, 0, 1e3, false, "weight of the ensemble's largest deviation against the reward"},
    {"horizon", 5, 1, 1000, true, "steps of a rollout"},
    {"rollout-every", 1000, 1, 1e9, true, "updates between rollouts"},
    {"rollout-rows", 50'000, 1, 65'536, true, "start rows of the rollouts"},
    {"rollout-lag", 0, 0, 1, true, "0: roll out the present policy, 1: that of one cycle ago"},
    {"model-retain", 5, 1, 1000, true, "cycles whose rollouts are kept"},
    {"chunk-rows", 2000, 1, limits::kMaxQueryRows, true, "rows of one query"},
    {"chunks-in-flight", 6, 1, limits::kMaxRequestsInFlight, true, "queries at the daemon at once"},
    {"real-ratio", 0.05, 0, 1, false, "share of a batch that comes from the dataset"},
    {"batch-size", 256, 1, 65'536, true, "rows of one update"},
    {"hidden-width", 256, 1, 4096, true, "units of each of the policy's two hidden layers"},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor, critics and entropy weight"},
    {"gamma", 0.99, 0, 1, false, "discount"},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update"},
    {"target-entropy", -3, -1e3, 1e3, false, "of the policy"},
    {"ensemble-members", 7, 1, 64, true, "correction networks"},
    {"ensemble-elites", 5, 1, 64, true, "best of them, which rollouts use"},
    {"ensemble-width", 200, 1, 4096, true, "units of each of their four hidden layers"},
    {"ensemble-learning-rate", 1e-3, 1e-8, 1, false, "Adam's"},
    {"ensemble-batch-size", 256, 1, 65'536, true, "rows of one update"},
    {"ensemble-max-updates", 800'000, 1, 1e12, true, "at most so many, tested after each epoch"},
    {"ensemble-patience", 5, 1, 1e6, true, "epochs without an improvement that end the training"},
};

DynamicsEnsembleOptions EnsembleOptions(const LearnerContext& context) {
  const Hyperparameters& values = context.hyperparameters;
  const int width = values.Integer("ensemble-width");
  DynamicsEnsembleOptions options;
  options.observation_size = context.observation_size();
  options.action_size = context.action_size();
  options.members = values.Integer("ensemble-members");
  options.elites = values.Integer("ensemble-elites");
  options.hidden = {width, width, width, width};
  options.learning_rate = values.Number("ensemble-learning-rate");
  options.batch_size = values.Integer("ensemble-batch-size");
  options.max_updates = static_cast<int64_t>(values.Number("ensemble-max-updates"));
  options.patience_epochs = values.Integer("ensemble-patience");
  options.seed = RoleSeed(context.seed, "ensemble");
  return options;
}

ModelRolloutOptions RolloutOptions(const LearnerContext& context, std::vector<float> mask) {
  const Hyperparameters& values = context.hyperparameters;
  ModelRolloutOptions options;
  options.observation_size = context.observation_size();
  options.action_size = context.action_size();
  options.horizon = values.Integer("horizon");
  options.penalty = values.Number("penalty");
  options.chunk_rows = values.Integer("chunk-rows");
  options.chunks_in_flight = values.Integer("chunks-in-flight");
  options.seed = RoleSeed(context.seed, "rollouts");
  options.action_scale = context.ActionScale();
  options.mask = std::move(mask);
  return options;
}

Result<RemoteEnvironment> OpenSimulator(const LearnerContext& context) {
  EnvironmentOptions options;
  options.simulator = context.simulator;
  options.num_envs = 0;  // queries alone
  options.deadline_ms = kLearnerDeadlineMs;
  options.seed = context.seed;
  return context.client->Make(context.environment.name, options);
}

// Room for all retained rollouts.
uint64_t PoolCapacity(const Hyperparameters& values) {
  return values.Unsigned("model-retain") * values.Unsigned("rollout-rows") *
         values.Unsigned("horizon");
}

// One cycle's rollouts in D_model.
struct Generation {
  uint64_t cycle;
  std::vector<float> policy;  // FlattenPolicy of the policy that made it
  uint64_t first_record;      // in D_model
};

class Hymopo : public Learner {
 public:
  Hymopo(const LearnerContext& context, SacCore<float> core, DynamicsEnsemble<float> ensemble,
         std::unique_ptr<RemoteDataset> dataset, RemoteEnvironment simulator, ReplayBuffer pool);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  std::string dataset_sha256() const override { return dataset_->in_force().info().sha256(); }

 private:
  Status TrainEnsemble(const ModelData& data, Progress& progress);
  Status StartCycle(MetricMeans& metrics);
  Status BeginRollout(uint64_t cycle, const PolicyWeights& policy);
  Result<RolloutCounts> FinishRollout(Generation generation);
  Status FillBatch();
  void StartStream();

  const LearnerContext& context_;
  const uint64_t rollout_every_;
  const bool lag_;
  const int real_rows_;  // of a batch
  SacCore<float> core_;
  DynamicsEnsemble<float> ensemble_;        // f
  std::unique_ptr<RemoteDataset> dataset_;  // D
  RemoteEnvironment simulator_;             // T_sim
  std::vector<float> mask_;
  std::vector<float> action_scale_;
  ModelRollout rollout_;
  ReplayBuffer pool_;                   // D_model
  std::deque<Generation> generations_;  // in D_model, oldest first
  std::optional<Generation> pending_;   // under way, with lag 1
  BatchBuffer batch_;                   // real rows first
  std::optional<BatchStream> stream_;
};

Hymopo::Hymopo(const LearnerContext& context, SacCore<float> core, DynamicsEnsemble<float> ensemble,
               std::unique_ptr<RemoteDataset> dataset, RemoteEnvironment simulator,
               ReplayBuffer pool)
    : context_(context),
      rollout_every_(context.hyperparameters.Unsigned("rollout-every")),
      lag_(context.hyperparameters.Integer("rollout-lag") == 1),
      real_rows_(static_cast<int>(context.hyperparameters.Number("real-ratio") *
                                  context.hyperparameters.Number("batch-size"))),
      core_(std::move(core)),
      ensemble_(std::move(ensemble)),
      dataset_(std::move(dataset)),
      simulator_(std::move(simulator)),
      mask_(
          MaskOfDimensions(dataset_->observation_size(), dataset_->in_force().hidden_dimensions())),
      action_scale_(context.ActionScale()),
      rollout_(RolloutOptions(context, mask_), &simulator_, &ensemble_),
      pool_(std::move(pool)),
      batch_(context.observation_size(), context.action_size(),
             context.hyperparameters.Integer("batch-size")) {}

Status Hymopo::Prepare(Progress& progress) {
  const uint64_t query_seed = RoleSeed(context_.seed, "pre-pass");
  B4MRL_ASSIGN_OR_RETURN(const ModelData data,
                         QueryCorrections(context_, *dataset_, simulator_, query_seed, progress));
  if (data.invalid_rows > 0) {
    progress.Message(fmt::format("the simulator could not answer {} of {} rows: dropped",
                                 data.invalid_rows, dataset_->rows()));
  }
  B4MRL_RETURN_IF_ERROR(TrainEnsemble(data, progress));
  // The training may have outlasted the idle session's lease.
  B4MRL_ASSIGN_OR_RETURN(simulator_, OpenSimulator(context_));
  StartStream();
  return Status();
}

Status Hymopo::TrainEnsemble(const ModelData& data, Progress& progress) {
  constexpr int64_t kUpdatesPerCall = 100;  // between two looks at the progress bar
  B4MRL_RETURN_IF_ERROR(ensemble_.StartTraining(data.view()));
  progress.Start("train ensemble", "updates",
                 static_cast<uint64_t>(ensemble_.options().max_updates));
  DynamicsProgress state;
  while (!state.finished) {
    state = ensemble_.Train(data.view(), kUpdatesPerCall);
    if (!std::isfinite(state.train_loss)) {
      return Status(
          StatusCode::kFailedPrecondition,
          fmt::format("the ensemble's loss became {} in epoch {}", state.train_loss, state.epoch));
    }
    std::string note;
    if (state.epoch_ended) {
      const double best = *std::min_element(state.holdout_mse.begin(), state.holdout_mse.end());
      note = fmt::format("epoch {}, hold-out error {:.4f}", state.epoch, best);
    }
    progress.Update(static_cast<uint64_t>(state.updates), note);
  }
  progress.Finish();
  return Status();
}

Status Hymopo::Update(MetricMeans& metrics) {
  const auto update = static_cast<uint64_t>(core_.updates());
  if (update % rollout_every_ == 0) B4MRL_RETURN_IF_ERROR(StartCycle(metrics));
  // The daemon simulates the next cycle's rollouts meanwhile. Each turn takes an answer that is
  // likely to be here, and which update takes it changes no number.
  constexpr uint64_t kUpdatesPerTurn = 4;
  if (update % kUpdatesPerTurn == 0) B4MRL_RETURN_IF_ERROR(rollout_.Advance());
  B4MRL_RETURN_IF_ERROR(FillBatch());
  AddMetrics(core_.Update(batch_.view()), metrics);
  return Status();
}

Status Hymopo::StartCycle(MetricMeans& metrics) {
  const uint64_t cycle = static_cast<uint64_t>(core_.updates()) / rollout_every_;
  if (!pending_) {  // no lag, or the first cycle
    const PolicyWeights policy = core_.Policy();
    B4MRL_RETURN_IF_ERROR(BeginRollout(cycle, policy));
    pending_ = Generation{cycle, FlattenPolicy(policy), 0};
  }
  B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, FinishRollout(*std::move(pending_)));
  pending_.reset();
  if (counts.rows == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("all {} rollouts of cycle {} left the finite numbers",
                              counts.invalid_rows, cycle));
  }
  metrics.Add("rollout_reward", counts.reward_sum / static_cast<double>(counts.rows));
  metrics.Add("rollout_invalid_rows", static_cast<double>(counts.invalid_rows));
  if (!lag_) return Status();
  const PolicyWeights policy = core_.Policy();
  pending_ = Generation{cycle + 1, FlattenPolicy(policy), 0};
  return BeginRollout(cycle + 1, policy);
}

Status Hymopo::BeginRollout(uint64_t cycle, const PolicyWeights& policy) {
  B4MRL_ASSIGN_OR_RETURN(
      const TransitionRows rows,
      dataset_->Sample(static_cast<uint32_t>(context_.hyperparameters.Integer("rollout-rows")),
                       RoleSeed(context_.seed, "rollout-starts"), cycle));
  return rollout_.Begin(cycle, {rows.observations.begin(), rows.observations.end()}, policy);
}

Result<RolloutCounts> Hymopo::FinishRollout(Generation generation) {
  generation.first_record = pool_.length();
  generations_.push_back(std::move(generation));
  if (generations_.size() > context_.hyperparameters.Unsigned("model-retain")) {
    generations_.pop_front();
  }
  B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, rollout_.Finish(pool_));
  pool_.DropBefore(generations_.front().first_record);
  return counts;
}

// Batch b of D is a function of (seed, b), so a resumed learner asks on where it stopped.
void Hymopo::StartStream() {
  if (real_rows_ == 0) return;
  stream_.emplace(dataset_->Stream(static_cast<uint32_t>(real_rows_),
                                   RoleSeed(context_.seed, "batches"),
                                   static_cast<uint64_t>(core_.updates())));
}

Status Hymopo::FillBatch() {
  if (real_rows_ > 0) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows real, stream_->Next());
    batch_.SetObservations(real.observations, real.next_observations);
    batch_.SetActions(real.actions, action_scale_);
    batch_.SetOutcomes(real.rewards, real.terminals);
  }
  Rng rows(RoleSeed(context_.seed, "model-rows"), "rows", static_cast<uint64_t>(core_.updates()));
  pool_.Sample(rows, real_rows_, batch_.size() - real_rows_, batch_);
  return Status();
}

PolicyWeights Hymopo::Policy() const {
  PolicyWeights weights = core_.Policy();
  weights.observation_mask = mask_;
  return weights;
}

Status Hymopo::Save(CheckpointWriter& writer) {
  core_.VisitArrays(writer.Arrays("core"));
  core_.VisitCounters(writer.Counters("core"));
  ensemble_.VisitArrays(writer.Arrays("ensemble"));
  ensemble_.VisitCounters(writer.Counters("ensemble"));
  writer.Text("dataset", dataset_->fingerprint());
  writer.Unsigned("generations", generations_.size());
  writer.Unsigned("pending", pending_ ? 1 : 0);
  std::vector<Generation> all(generations_.begin(), generations_.end());
  if (pending_) all.push_back(*pending_);
  for (size_t i = 0; i < all.size(); ++i) {
    writer.Unsigned(fmt::format("generation{}/cycle", i), all[i].cycle);
    writer.Floats(fmt::format("generation{}/policy", i), all[i].policy);
  }
  return Status();
}

Status Hymopo::Load(CheckpointReader& reader) {
  core_.VisitArrays(reader.Arrays("core"));
  core_.VisitCounters(reader.Counters("core"));
  ensemble_.VisitArrays(reader.Arrays("ensemble"));
  ensemble_.VisitCounters(reader.Counters("ensemble"));
  B4MRL_RETURN_IF_ERROR(CheckSameDataset(reader, *dataset_));
  const uint64_t kept = reader.Unsigned("generations");
  const uint64_t pending = reader.Unsigned("pending");
  for (uint64_t i = 0; i < kept + pending; ++i) {
    Generation generation = {reader.Unsigned(fmt::format("generation{}/cycle", i)),
                             reader.Floats(fmt::format("generation{}/policy", i)), 0};
    B4MRL_RETURN_IF_ERROR(reader.status());
    PolicyWeights policy = core_.Policy();
    if (!UnflattenPolicy(generation.policy, policy)) {
      return Status(StatusCode::kDataLoss, fmt::format("generation{}/policy has another size", i));
    }
    B4MRL_RETURN_IF_ERROR(BeginRollout(generation.cycle, policy));
    if (i == kept) {
      pending_ = std::move(generation);
    } else {
      B4MRL_RETURN_IF_ERROR(FinishRollout(std::move(generation)).status());
    }
  }
  StartStream();
  return Status();
}

}  // namespace

std::span<const Hyperparameter> HymopoHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateHymopo(const LearnerContext& context) {
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core,
                         SacCore<float>::Create(SacOptionsOf(context, context.observation_size())));
  B4MRL_ASSIGN_OR_RETURN(DynamicsEnsemble<float> ensemble,
                         DynamicsEnsemble<float>::Create(EnsembleOptions(context)));
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<RemoteDataset> dataset, OpenTrainingDataset(context));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment simulator, OpenSimulator(context));
  B4MRL_ASSIGN_OR_RETURN(
      ReplayBuffer pool,
      ReplayBuffer::InMemory({.observation_size = context.observation_size(),
                              .action_size = context.action_size(),
                              .capacity = PoolCapacity(context.hyperparameters)}));
  return std::unique_ptr<Learner>(std::make_unique<Hymopo>(context, std::move(core),
                                                           std::move(ensemble), std::move(dataset),
                                                           std::move(simulator), std::move(pool)));
}

}  // namespace b4mrl
