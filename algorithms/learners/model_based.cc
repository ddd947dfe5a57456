#include "algorithms/learners/model_based.h"

#include <fmt/format.h>

#include <utility>

#include "algorithms/experience/training_simulator.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/model_based_options.h"
#include "algorithms/model/ensemble_store.h"
#include "algorithms/policy/inference.h"

namespace b4mrl {
namespace {

// Capacity of D_model, in transitions: enough for all rollouts of `model-retain` cycles.
uint64_t PoolCapacity(const Hyperparameters& values) {
  return values.Unsigned("model-retain") * values.Unsigned("rollout-rows") *
         values.Unsigned("horizon");
}

}  // namespace

ModelBased::ModelBased(const LearnerContext& context, Parts parts)
    : context_(context),
      dataset_(std::move(parts.dataset)),
      simulator_(std::move(parts.simulator)),
      core_(std::move(parts.core)),
      ensemble_(std::move(parts.ensemble)),
      rollout_every_(context.hyperparameters.Unsigned("rollout-every")),
      lag_(context.hyperparameters.Integer("rollout-lag") == 1),
      rollout_(RolloutOptionsOf(context, dataset_.mask(), std::move(parts.termination)),
               simulator_ ? &*simulator_ : nullptr, &ensemble_),
      pool_(std::move(parts.pool)),
      batch_(context.observation_size(), context.action_size(),
             context.hyperparameters.Integer("batch-size")),
      action_scale_(context.ActionScale()) {}

Status ModelBased::TrainModel(const ModelData& data, Progress& progress) {
  if (*context_.stop) return Status();  // `data` may be incomplete then
  if (data.invalid_rows > 0) {
    progress.Message(
        fmt::format("{} of {} rows dropped: they have no next observation, the simulator could not "
                    "answer them, or a number is not finite",
                    data.invalid_rows, dataset_.remote().rows()));
  }
  B4MRL_ASSIGN_OR_RETURN(
      const EnsembleTraining training,
      TrainEnsemble(data.view(), EnsembleFilesOf(context_), ensemble_, progress, *context_.stop));
  ensemble_key_ = training.key;
  ensemble_seconds_before_ = training.seconds_before;
  // The training may have outlasted the idle session's lease.
  if (simulator_) {
    B4MRL_ASSIGN_OR_RETURN(*simulator_, OpenTrainingSimulator(context_, /*lanes=*/0));
    last_rollout_ = Clock::now();
  }
  dataset_.Start(0);
  return Status();
}

Status ModelBased::Update(MetricMeans& metrics) {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows real, dataset_.Next());
  B4MRL_RETURN_IF_ERROR(RollOut(metrics));
  AddMetrics(core_.Update(FillBatch(real)), metrics);
  return Status();
}

Status ModelBased::RollOut(MetricMeans& metrics) {
  if (updates() % rollout_every_ != 0) return Status();
  const uint64_t cycle = updates() / rollout_every_;
  if (!pending_) {  // no lag, or the first cycle
    B4MRL_ASSIGN_OR_RETURN(pending_, BeginRollout(cycle, core_.Policy()));
  }
  Generation finished = *pending_;
  finished.first_record = pool_.length();
  B4MRL_ASSIGN_OR_RETURN(const RolloutCounts counts, rollout_.Finish(pool_));
  if (counts.rows == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("all {} rollouts of cycle {} left the finite numbers, or what the "
                              "simulator can answer",
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

Result<ModelBased::Generation> ModelBased::BeginRollout(uint64_t cycle,
                                                        const PolicyWeights& policy) {
  B4MRL_ASSIGN_OR_RETURN(
      std::vector<float> starts,
      DrawStarts(dataset_.remote(),
                 static_cast<uint32_t>(context_.hyperparameters.Integer("rollout-rows")),
                 RoleSeed(context_.seed, "rollout-starts"), cycle));
  // The updates since the last cycle may have outlasted the idle session's lease.
  if (simulator_ && IsDueAgain(*context_.client, last_rollout_)) {
    B4MRL_ASSIGN_OR_RETURN(*simulator_, OpenTrainingSimulator(context_, /*lanes=*/0));
  }
  last_rollout_ = Clock::now();
  B4MRL_RETURN_IF_ERROR(rollout_.Begin(cycle, std::move(starts), policy));
  return Generation{cycle, FlattenPolicy(policy), 0};
}

// Keeps a generation whose rows are in D_model, and drops the rows of the oldest generation beyond
// `model-retain`.
void ModelBased::Keep(Generation generation) {
  generations_.push_back(std::move(generation));
  if (generations_.size() > context_.hyperparameters.Unsigned("model-retain")) {
    generations_.pop_front();
  }
  pool_.DropBefore(generations_.front().first_record);
}

TransitionBatch<float> ModelBased::FillBatch(const TransitionRows& real) {
  const int real_rows = static_cast<int>(real.rows);
  if (real_rows > 0) batch_.SetRows(real, 0, real.rows, action_scale_);
  Rng rows(RoleSeed(context_.seed, "model-rows"), "rows", updates());
  pool_.Sample(rows, real_rows, batch_.size() - real_rows, batch_);
  return batch_.view();
}

PolicyWeights ModelBased::Policy() const {
  PolicyWeights weights = core_.Policy();
  weights.observation_mask = dataset_.mask();
  return weights;
}

Status ModelBased::Save(CheckpointWriter& writer) {
  writer.State("core", core_);
  writer.Text("ensemble", ensemble_key_);
  dataset_.Save(writer);
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
  B4MRL_RETURN_IF_ERROR(dataset_.Load(reader, updates()));
  B4MRL_RETURN_IF_ERROR(LoadTrainedEnsemble(ensemble_key_, EnsembleFilesOf(context_), ensemble_));
  const uint64_t kept = reader.Unsigned("generations");
  const uint64_t pending = reader.Unsigned("pending");
  B4MRL_RETURN_IF_ERROR(reader.status());
  if (kept > context_.hyperparameters.Unsigned("model-retain") || pending > 1) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} generations and {} pending ones are too many", kept, pending));
  }
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
  return Status();
}

Result<ModelBased::Parts> ModelBased::Open(const LearnerContext& context, bool uses_simulator) {
  const Hyperparameters& values = context.hyperparameters;
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core,
                         SacCore<float>::Create(SacOptionsOf(context, context.observation_size())));
  B4MRL_ASSIGN_OR_RETURN(DynamicsEnsemble<float> ensemble,
                         DynamicsEnsemble<float>::Create(EnsembleOptionsOf(context),
                                                         static_cast<int>(context.threads)));
  B4MRL_ASSIGN_OR_RETURN(TrainingDataset dataset, TrainingDataset::Open(context, RealRows(values)));
  std::optional<RemoteEnvironment> simulator;
  if (uses_simulator) {
    B4MRL_ASSIGN_OR_RETURN(simulator, OpenTrainingSimulator(context, /*lanes=*/0));
  }
  // Without a termination rule, a simulator reports ends of episodes; MOPO's model alone cannot.
  Result<Termination> rule = Termination::Of(context.environment, dataset.mask());
  if (!rule.ok() && !uses_simulator) return rule.status();
  std::optional<Termination> termination;
  if (rule.ok()) termination = *std::move(rule);
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer pool,
                         ReplayBuffer::InMemory({.observation_size = context.observation_size(),
                                                 .action_size = context.action_size(),
                                                 .capacity = PoolCapacity(values)}));
  return Parts{std::move(core),      std::move(ensemble),    std::move(dataset),
               std::move(simulator), std::move(termination), std::move(pool)};
}

}  // namespace b4mrl
