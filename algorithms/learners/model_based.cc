#include "algorithms/learners/model_based.h"

#include <fmt/format.h>

#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/cores/sac_core.h"
#include "algorithms/experience/batch_buffer.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/experience/training_dataset.h"
#include "algorithms/experience/training_simulator.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/model_based_options.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "algorithms/model/ensemble_store.h"
#include "algorithms/model/model_rollout.h"
#include "algorithms/policy/inference.h"
#include "algorithms/policy/observation_mask.h"

namespace b4mrl {
namespace {

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

// What a learner is made of.
struct Parts {
  SacCore<float> core;
  DynamicsEnsemble<float> ensemble;
  std::unique_ptr<RemoteDataset> dataset;
  std::vector<float> mask;  // of the dataset's observations
  std::optional<RemoteEnvironment> simulator;
  std::optional<Termination> termination;
  ReplayBuffer pool;
};

class ModelBased : public Learner {
 public:
  ModelBased(const LearnerContext& context, const ModelBasedAlgorithm& algorithm, Parts parts);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  bool outlives_daemon() const override { return true; }
  std::string dataset_sha256() const override { return dataset_->in_force().info().sha256(); }

 private:
  Status StartCycle(MetricMeans& metrics);
  Result<Generation> BeginRollout(uint64_t cycle, const PolicyWeights& policy);
  void Keep(Generation generation);
  void FillBatch(const TransitionRows& real);
  void StartStream();
  RemoteEnvironment* simulator() { return simulator_ ? &*simulator_ : nullptr; }

  const LearnerContext& context_;
  const ModelBasedAlgorithm algorithm_;
  const uint64_t rollout_every_;
  const bool lag_;
  const int real_rows_;  // of a batch
  SacCore<float> core_;
  DynamicsEnsemble<float> ensemble_;  // f
  std::string ensemble_key_;
  std::unique_ptr<RemoteDataset> dataset_;  // D
  std::vector<float> mask_;
  std::optional<RemoteEnvironment> simulator_;  // T_sim
  ModelRollout rollout_;
  ReplayBuffer pool_;                   // D_model
  std::deque<Generation> generations_;  // in D_model, oldest first
  std::optional<Generation> pending_;   // under way, with lag 1
  BatchBuffer batch_;                   // real rows first
  std::vector<float> action_scale_;
  std::optional<BatchStream> stream_;
};

ModelBased::ModelBased(const LearnerContext& context, const ModelBasedAlgorithm& algorithm,
                       Parts parts)
    : context_(context),
      algorithm_(algorithm),
      rollout_every_(context.hyperparameters.Unsigned("rollout-every")),
      lag_(context.hyperparameters.NumberOr("rollout-lag", 0) == 1),
      real_rows_(RealRows(context.hyperparameters)),
      core_(std::move(parts.core)),
      ensemble_(std::move(parts.ensemble)),
      dataset_(std::move(parts.dataset)),
      mask_(std::move(parts.mask)),
      simulator_(std::move(parts.simulator)),
      rollout_(RolloutOptionsOf(context, mask_, std::move(parts.termination)), simulator(),
               &ensemble_),
      pool_(std::move(parts.pool)),
      batch_(context.observation_size(), context.action_size(),
             context.hyperparameters.Integer("batch-size")),
      action_scale_(context.ActionScale()) {}

Status ModelBased::Prepare(Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(const ModelData data,
                         algorithm_.read_targets(context_, *dataset_, simulator(), progress));
  if (*context_.stop) return Status();  // perhaps not all of them
  if (data.invalid_rows > 0) {
    progress.Message(fmt::format("{} of {} rows have no finite target for the model: dropped",
                                 data.invalid_rows, dataset_->rows()));
  }
  B4MRL_ASSIGN_OR_RETURN(ensemble_key_, TrainEnsemble(data.view(), EnsembleFilesOf(context_),
                                                      ensemble_, progress, *context_.stop));
  // The training may have outlasted the idle session's lease.
  if (simulator_) {
    B4MRL_ASSIGN_OR_RETURN(*simulator_, OpenTrainingSimulator(context_, /*lanes=*/0));
  }
  StartStream();
  return Status();
}

// What asks the daemon comes first, and nothing that Save stores changes before its last answer.
Status ModelBased::Update(MetricMeans& metrics) {
  const auto update = static_cast<uint64_t>(core_.updates());
  TransitionRows real;
  if (real_rows_ > 0) {
    B4MRL_ASSIGN_OR_RETURN(real, stream_->Next());
  }
  if (update % rollout_every_ == 0) B4MRL_RETURN_IF_ERROR(StartCycle(metrics));
  FillBatch(real);
  AddMetrics(core_.Update(batch_.view()), metrics);
  return Status();
}

Status ModelBased::StartCycle(MetricMeans& metrics) {
  const uint64_t cycle = static_cast<uint64_t>(core_.updates()) / rollout_every_;
  if (!pending_) {  // no lag, or the first cycle
    B4MRL_ASSIGN_OR_RETURN(pending_, BeginRollout(cycle, core_.Policy()));
  }
  Generation finished = *pending_;
  finished.first_record = pool_.length();
  B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, rollout_.Finish(pool_));
  if (counts.rows == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("all {} rollouts of cycle {} left the finite numbers",
                              counts.invalid_rows, cycle));
  }
  std::optional<Generation> next;
  if (lag_) {
    B4MRL_ASSIGN_OR_RETURN(next, BeginRollout(cycle + 1, core_.Policy()));
  }
  Keep(std::move(finished));
  pending_ = std::move(next);
  metrics.Add("rollout_reward", counts.reward_sum / static_cast<double>(counts.rows));
  metrics.Add("rollout_invalid_rows", static_cast<double>(counts.invalid_rows));
  metrics.Add("rollout_terminated_rows", static_cast<double>(counts.terminated_rows));
  return Status();
}

Result<Generation> ModelBased::BeginRollout(uint64_t cycle, const PolicyWeights& policy) {
  B4MRL_ASSIGN_OR_RETURN(
      std::vector<float> starts,
      DrawStarts(*dataset_, static_cast<uint32_t>(context_.hyperparameters.Integer("rollout-rows")),
                 RoleSeed(context_.seed, "rollout-starts"), cycle));
  B4MRL_RETURN_IF_ERROR(rollout_.Begin(cycle, std::move(starts), policy));
  return Generation{cycle, FlattenPolicy(policy), 0};
}

// Makes room for it in D_model, which has its rows already.
void ModelBased::Keep(Generation generation) {
  generations_.push_back(std::move(generation));
  if (generations_.size() > context_.hyperparameters.Unsigned("model-retain")) {
    generations_.pop_front();
  }
  pool_.DropBefore(generations_.front().first_record);
}

// Batch b of D is a function of (seed, b), so a resumed learner asks on where it stopped.
void ModelBased::StartStream() {
  if (real_rows_ == 0) return;
  stream_.emplace(dataset_->Stream(static_cast<uint32_t>(real_rows_),
                                   RoleSeed(context_.seed, "batches"),
                                   static_cast<uint64_t>(core_.updates())));
}

// Real rows keep the dataset's reward; the penalty is in the model's rows.
void ModelBased::FillBatch(const TransitionRows& real) {
  if (real_rows_ > 0) batch_.SetRows(real, 0, real.rows, action_scale_);
  Rng rows(RoleSeed(context_.seed, "model-rows"), "rows", static_cast<uint64_t>(core_.updates()));
  pool_.Sample(rows, real_rows_, batch_.size() - real_rows_, batch_);
}

PolicyWeights ModelBased::Policy() const {
  PolicyWeights weights = core_.Policy();
  weights.observation_mask = mask_;
  return weights;
}

Status ModelBased::Save(CheckpointWriter& writer) {
  writer.State("core", core_);
  writer.Text("ensemble", ensemble_key_);
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

Status ModelBased::Load(CheckpointReader& reader) {
  reader.StateInto("core", core_);
  ensemble_key_ = reader.Text("ensemble");
  B4MRL_RETURN_IF_ERROR(CheckSameDataset(reader, *dataset_));
  B4MRL_RETURN_IF_ERROR(LoadTrainedEnsemble(ensemble_key_, EnsembleFilesOf(context_), ensemble_));
  const uint64_t kept = reader.Unsigned("generations");
  const uint64_t pending = reader.Unsigned("pending");
  for (uint64_t i = 0; i < kept + pending; ++i) {
    const uint64_t cycle = reader.Unsigned(fmt::format("generation{}/cycle", i));
    const std::vector<float> numbers = reader.Floats(fmt::format("generation{}/policy", i));
    B4MRL_RETURN_IF_ERROR(reader.status());
    PolicyWeights policy = core_.Policy();
    if (!UnflattenPolicy(numbers, policy)) {
      return Status(StatusCode::kDataLoss, fmt::format("generation{}/policy has another size", i));
    }
    B4MRL_ASSIGN_OR_RETURN(Generation generation, BeginRollout(cycle, policy));
    if (i == kept) {
      pending_ = std::move(generation);
    } else {
      generation.first_record = pool_.length();
      B4MRL_RETURN_IF_ERROR(rollout_.Finish(pool_).status());
      Keep(std::move(generation));
    }
  }
  StartStream();
  return Status();
}

}  // namespace

Result<std::unique_ptr<Learner>> CreateModelBased(const LearnerContext& context,
                                                  const ModelBasedAlgorithm& algorithm) {
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core,
                         SacCore<float>::Create(SacOptionsOf(context, context.observation_size())));
  B4MRL_ASSIGN_OR_RETURN(DynamicsEnsemble<float> ensemble,
                         DynamicsEnsemble<float>::Create(EnsembleOptionsOf(context),
                                                         static_cast<int>(context.threads)));
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<RemoteDataset> dataset, OpenTrainingDataset(context));
  std::vector<float> mask =
      MaskOfDimensions(dataset->observation_size(), dataset->in_force().hidden_dimensions());
  std::optional<RemoteEnvironment> simulator;
  if (algorithm.uses_simulator) {
    B4MRL_ASSIGN_OR_RETURN(simulator, OpenTrainingSimulator(context, /*lanes=*/0));
  }
  // Where there is no rule, a simulator tells; a model alone cannot.
  Result<Termination> rule = Termination::Of(context.environment, mask);
  if (!rule.ok() && !algorithm.uses_simulator) return rule.status();
  std::optional<Termination> termination;
  if (rule.ok()) termination = *std::move(rule);
  B4MRL_ASSIGN_OR_RETURN(
      ReplayBuffer pool,
      ReplayBuffer::InMemory({.observation_size = context.observation_size(),
                              .action_size = context.action_size(),
                              .capacity = PoolCapacity(context.hyperparameters)}));
  return std::unique_ptr<Learner>(std::make_unique<ModelBased>(
      context, algorithm,
      Parts{std::move(core), std::move(ensemble), std::move(dataset), std::move(mask),
            std::move(simulator), std::move(termination), std::move(pool)}));
}

}  // namespace b4mrl
