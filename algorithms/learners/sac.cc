// Soft actor-critic, online in a simulator (Haarnoja et al. 2018; defaults of Stable-Baselines3).
//
//   s, a, r, s'  observation, action in [-1, 1], reward, next observation     d  terminated
//   D            replay buffer: all transitions in a file, the newest `replay-capacity` sampled
//   pi, Q        actor and twin critics (rl/sac_core.h)
//
//   warm up:  D <- `warm-up` transitions of uniform actions
//   repeat:   a ~ pi(s);  s', r, d <- simulator;  D <- D + (s, a, r, s', d)      in every lane
//             one update per transition:  a batch from D, one step of Q, pi and the entropy weight
//
// An episode that ends by the step limit keeps d = 0: its value bootstraps from the final
// observation.
#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "algorithms/learners/learners.h"
#include "algorithms/rl/batch_buffer.h"
#include "algorithms/rl/core_metrics.h"
#include "algorithms/rl/core_options.h"
#include "algorithms/rl/hidden_dimensions.h"
#include "algorithms/rl/observation_history.h"
#include "algorithms/rl/replay_buffer.h"
#include "algorithms/rl/sac_core.h"
#include "algorithms/rl/tensor_rows.h"
#include "client/client.h"
#include "client/remote_environment.h"

namespace b4mrl {
namespace {

constexpr Hyperparameter kHyperparameters[] = {
    {"lanes", 1, 1, 1024, true, "environments stepped at once; as many updates follow"},
    {"warm-up", 10'000, 1, 1e9, true, "transitions of uniform actions before the first update"},
    {"replay-capacity", 1e6, 1, 1e9, true, "newest transitions that batches are drawn from"},
    {"batch-size", 256, 1, 65'536, true, "rows of one update"},
    {"hidden-width", 256, 1, 4096, true, "units of each of the two hidden layers"},
    {"learning-rate", 3e-4, 1e-8, 1, false, "Adam's, of actor, critics and entropy weight"},
    {"gamma", 0.99, 0, 1, false, "discount"},
    {"tau", 0.005, 0, 1, false, "how far the targets follow in one update"},
    {"initial-alpha", 1, 1e-9, 1e3, false, "entropy weight at the start"},
};

class Sac : public Learner {
 public:
  Sac(const LearnerContext& context, SacCore<float> core, RemoteEnvironment simulator,
      std::vector<float> mask);

  Status Prepare(Progress& progress) override;
  Status Update(MetricMeans& metrics) override;
  PolicyWeights Policy() const override;
  Status Save(CheckpointWriter& writer) override;
  Status Load(CheckpointReader& reader) override;
  uint64_t environment_steps() const override { return vector_steps_ * lanes_; }

 private:
  void UniformActions();
  Status PolicyActions();
  Status StepAndStore();
  Status Store(int lane, const StepOutcome& outcome, std::span<const float> final_observation);
  std::string ReplayPath() const { return context_.folder + "/replay.bin"; }

  const LearnerContext& context_;
  SacCore<float> core_;
  RemoteEnvironment simulator_;
  const std::vector<float> mask_;  // of one observation; empty: nothing hidden
  const std::vector<float> action_scale_;
  const uint32_t lanes_;
  const ReplayBuffer::Options replay_options_;

  std::optional<ReplayBuffer> replay_;  // D
  ObservationHistory histories_;        // s of every lane
  std::vector<float> previous_;         // one lane's s while its s' is made
  MatrixBuffer<float> actions_;         // a, in [-1, 1]
  MatrixBuffer<float> scaled_actions_;  // the same in the environment's units
  MatrixBuffer<float> noise_;
  BatchBuffer batch_;
  uint64_t vector_steps_ = 0;
  uint32_t updates_due_ = 0;  // for the transitions gathered last
};

ReplayBuffer::Options ReplayOptions(const LearnerContext& context) {
  const auto history = static_cast<int>(context.history_length);
  return {.observation_size = history * context.observation_size(),
          .action_size = context.action_size(),
          .capacity = context.hyperparameters.Unsigned("replay-capacity")};
}

Sac::Sac(const LearnerContext& context, SacCore<float> core, RemoteEnvironment simulator,
         std::vector<float> mask)
    : context_(context),
      core_(std::move(core)),
      simulator_(std::move(simulator)),
      mask_(std::move(mask)),
      action_scale_(context.ActionScale()),
      lanes_(simulator_.num_envs()),
      replay_options_(ReplayOptions(context)),
      histories_(static_cast<int>(context.history_length), context.observation_size(),
                 static_cast<int>(lanes_)),
      previous_(replay_options_.observation_size),
      actions_(context.action_size(), static_cast<int>(lanes_)),
      scaled_actions_(context.action_size(), static_cast<int>(lanes_)),
      noise_(context.action_size(), static_cast<int>(lanes_)),
      batch_(replay_options_.observation_size, context.action_size(),
             context.hyperparameters.Integer("batch-size")) {}

Status Sac::Prepare(Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer replay,
                         ReplayBuffer::CreateFile(ReplayPath(), replay_options_));
  replay_.emplace(std::move(replay));
  std::vector<uint64_t> seeds;
  for (uint32_t lane = 0; lane < lanes_; ++lane) {
    seeds.push_back(RoleSeed(context_.seed, "train-lane", lane));
  }
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, simulator_.Reset({}, seeds));
  for (uint32_t lane = 0; lane < lanes_; ++lane) {
    histories_.Reset(static_cast<int>(lane), RowOf(first.observations, lane));
  }
  const uint64_t warm_up = context_.hyperparameters.Unsigned("warm-up");
  progress.Start("warm up", "transitions", warm_up);
  while (replay_->length() < warm_up) {
    UniformActions();
    B4MRL_RETURN_IF_ERROR(StepAndStore());
    progress.Update(replay_->length());
  }
  progress.Finish();
  return Status();
}

Status Sac::Update(MetricMeans& metrics) {
  if (updates_due_ == 0) {
    B4MRL_RETURN_IF_ERROR(PolicyActions());
    B4MRL_RETURN_IF_ERROR(StepAndStore());
    updates_due_ = lanes_;
  }
  --updates_due_;
  Rng rows(RoleSeed(context_.seed, "replay"), "rows", static_cast<uint64_t>(core_.updates()));
  replay_->Sample(rows, 0, batch_.size(), batch_);
  AddMetrics(core_.Update(batch_.view()), metrics);
  return Status();
}

void Sac::UniformActions() {
  Rng rng(RoleSeed(context_.seed, "warm-up"), "actions", vector_steps_);
  for (float& action : actions_.values()) action = static_cast<float>(rng.Uniform(-1, 1));
}

Status Sac::PolicyActions() {
  B4MRL_ASSIGN_OR_RETURN(const FixedOrderPolicy policy, FixedOrderPolicy::Create(core_.Policy()));
  Rng rng(RoleSeed(context_.seed, "explore"), "actions", vector_steps_);
  rng.FillNormal(noise_.values());
  policy.Sample(histories_.view(), noise_.view(), actions_.view());
  return Status();
}

Status Sac::StepAndStore() {
  for (uint32_t lane = 0; lane < lanes_; ++lane) {
    for (int i = 0; i < context_.action_size(); ++i) {
      scaled_actions_.view()(i, lane) = actions_.view()(i, lane) * action_scale_[i];
    }
  }
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, simulator_.Step(scaled_actions_.values()));
  ++vector_steps_;
  size_t ended = 0;  // position in final_lanes, which are in order
  for (uint32_t lane = 0; lane < lanes_; ++lane) {
    std::span<const float> final_observation;
    if (ended < outcome.final_lanes.size() && outcome.final_lanes[ended] == lane) {
      final_observation = RowOf(outcome.final_observations, ended++);
    }
    B4MRL_RETURN_IF_ERROR(Store(static_cast<int>(lane), outcome, final_observation));
  }
  return Status();
}

Status Sac::Store(int lane, const StepOutcome& outcome, std::span<const float> final_observation) {
  const std::span<const float> observation = RowOf(outcome.observations, lane);
  const bool ended = !final_observation.empty();
  const std::span<const float> stacked = histories_.lane(lane);
  std::copy(stacked.begin(), stacked.end(), previous_.begin());
  histories_.Push(lane, ended ? final_observation : observation);

  // A step that the daemon or the physics engine gave up has no outcome to learn from.
  const auto cause = static_cast<Cause>(outcome.causes[lane]);
  if (cause != Cause::kCrash && cause != Cause::kNumericalError) {
    const float* action = actions_.view().column(lane);
    B4MRL_RETURN_IF_ERROR(
        replay_->Append({.observation = previous_,
                         .action = {action, static_cast<size_t>(context_.action_size())},
                         .next_observation = histories_.lane(lane),
                         .reward = static_cast<float>(outcome.rewards[lane]),
                         .terminated = outcome.terminated[lane] != 0}));
  }
  if (ended) histories_.Reset(lane, observation);
  return Status();
}

PolicyWeights Sac::Policy() const {
  PolicyWeights weights = core_.Policy();
  for (uint32_t i = 0; i < context_.history_length; ++i) {
    weights.observation_mask.insert(weights.observation_mask.end(), mask_.begin(), mask_.end());
  }
  return weights;
}

Status Sac::Save(CheckpointWriter& writer) {
  B4MRL_RETURN_IF_ERROR(replay_->Sync());
  B4MRL_ASSIGN_OR_RETURN(const LaneStates states, simulator_.Snapshot());
  core_.VisitArrays(writer.Arrays("core"));
  core_.VisitCounters(writer.Counters("core"));
  writer.Bytes("lanes", states.snapshot);
  writer.Floats("histories", histories_.values());
  writer.Unsigned("replay_length", replay_->length());
  writer.Unsigned("vector_steps", vector_steps_);
  writer.Unsigned("updates_due", updates_due_);
  return Status();
}

Status Sac::Load(CheckpointReader& reader) {
  core_.VisitArrays(reader.Arrays("core"));
  core_.VisitCounters(reader.Counters("core"));
  LaneStates states;
  states.lanes = lanes_;
  states.snapshot = reader.Bytes("lanes");
  reader.FloatsInto("histories", histories_.values());
  const uint64_t length = reader.Unsigned("replay_length");
  vector_steps_ = reader.Unsigned("vector_steps");
  updates_due_ = static_cast<uint32_t>(reader.Unsigned("updates_due"));
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer replay,
                         ReplayBuffer::ResumeFile(ReplayPath(), replay_options_, length));
  replay_.emplace(std::move(replay));
  return simulator_.Restore(states).status();
}

}  // namespace

std::span<const Hyperparameter> SacHyperparameters() { return kHyperparameters; }

Result<std::unique_ptr<Learner>> CreateSac(const LearnerContext& context) {
  const auto history = static_cast<int>(context.history_length);
  B4MRL_ASSIGN_OR_RETURN(SacCore<float> core, SacCore<float>::Create(SacOptionsOf(
                                                  context, history * context.observation_size())));
  EnvironmentOptions options;
  options.simulator = context.simulator;
  options.num_envs = static_cast<uint32_t>(context.hyperparameters.Integer("lanes"));
  options.seed = context.seed;  // the lanes get their own seeds at the first reset
  options.autoreset_mode = AutoresetMode::kSameStep;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment simulator,
                         context.client->Make(context.environment.name, options));
  B4MRL_ASSIGN_OR_RETURN(
      std::vector<float> mask,
      MaskOfPerturbations(simulator.spec().observation, simulator.in_force().perturbations()));
  return std::unique_ptr<Learner>(
      std::make_unique<Sac>(context, std::move(core), std::move(simulator), std::move(mask)));
}

}  // namespace b4mrl
