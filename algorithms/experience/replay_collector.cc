#include "algorithms/experience/replay_collector.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "algorithms/experience/training_simulator.h"
#include "algorithms/policy/observation_mask.h"
#include "proto/wire/named_arguments.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

ReplayBuffer::Options ReplayOptions(const LearnerContext& context) {
  ReplayBuffer::Options options;
  options.observation_size = static_cast<int>(context.history_length) * context.observation_size();
  options.action_size = context.action_size();
  options.capacity = static_cast<uint64_t>(
      context.hyperparameters.NumberOr("replay-capacity", static_cast<double>(options.capacity)));
  return options;
}

// Vector steps in a row that stored nothing after which the simulator counts as unusable; single
// steps fail now and then.
constexpr uint64_t kBarrenVectorSteps = 1000;

}  // namespace

Result<ReplayCollector> ReplayCollector::Open(const LearnerContext& context,
                                              std::optional<std::vector<float>> mask) {
  const auto lanes = static_cast<uint32_t>(context.hyperparameters.NumberOr("lanes", 1));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment simulator, OpenTrainingSimulator(context, lanes));
  if (!mask) {
    B4MRL_ASSIGN_OR_RETURN(
        mask, MaskOfPerturbations(simulator.spec().observation,
                                  NamedArgumentsOf(simulator.in_force().perturbations())));
  }
  return ReplayCollector(context, std::move(simulator), *std::move(mask));
}

ReplayCollector::ReplayCollector(const LearnerContext& context, RemoteEnvironment simulator,
                                 std::vector<float> mask)
    : context_(&context),
      simulator_(std::move(simulator)),
      mask_(std::move(mask)),
      action_scale_(context.ActionScale()),
      count_(simulator_.num_envs()),
      exploration_noise_(
          static_cast<float>(context.hyperparameters.NumberOr("exploration-noise", 0))),
      replay_options_(ReplayOptions(context)),
      histories_(static_cast<int>(context.history_length), context.observation_size(),
                 static_cast<int>(count_)),
      previous_(replay_options_.observation_size),
      visible_(context.observation_size()),
      actions_(context.action_size(), static_cast<int>(count_)),
      scaled_actions_(context.action_size(), static_cast<int>(count_)),
      noise_(context.action_size(), static_cast<int>(count_)) {}

Status ReplayCollector::Start() {
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer replay,
                         ReplayBuffer::CreateFile(ReplayPath(), replay_options_));
  replay_.emplace(std::move(replay));
  std::vector<uint64_t> seeds;
  for (uint32_t lane = 0; lane < count_; ++lane) {
    seeds.push_back(TrainLaneSeed(context_->seed, lane));
  }
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, simulator_.Reset({}, seeds));
  for (uint32_t lane = 0; lane < count_; ++lane) {
    histories_.Reset(static_cast<int>(lane), Visible(RowOf(first.observations, lane)));
  }
  return Status();
}

Status ReplayCollector::WarmUp(uint64_t transitions, Progress& progress) {
  progress.Start("warm up", "transitions", transitions);
  uint64_t last_stored = vector_steps_;
  while (replay_->length() < transitions && !*context_->stop) {
    const uint64_t length = replay_->length();
    Rng rng(RoleSeed(context_->seed, "warm-up"), "actions", vector_steps_);
    for (float& action : actions_.values()) action = static_cast<float>(rng.Uniform(-1, 1));
    B4MRL_RETURN_IF_ERROR(StepAndStore().status());
    progress.Update(replay_->length());
    if (replay_->length() > length) last_stored = vector_steps_;
    if (vector_steps_ - last_stored < kBarrenVectorSteps) continue;
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("none of {} vector steps after one another led to states that the "
                              "simulator could give",
                              kBarrenVectorSteps));
  }
  warm_up_steps_ = vector_steps_;
  progress.Finish();
  return Status();
}

Status ReplayCollector::Step(const FixedOrderPolicy& policy, MetricMeans& metrics) {
  Explore(policy);
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, StepAndStore());
  std::vector<double> returns;
  for (size_t i = 0; i < outcome.final_returns.size(); ++i) {
    // A lane takes a step in every vector step, so an episode's length says when it began.
    const bool in_warm_up = outcome.final_lengths[i] > vector_steps_ - warm_up_steps_;
    if (!in_warm_up) returns.push_back(outcome.final_returns[i]);
  }
  metrics.AddAll("episodic_return", returns);
  return Status();
}

Status ReplayCollector::Collect(const PolicyWeights& policy, uint64_t steps, MetricMeans& metrics) {
  if (acting_) {
    B4MRL_RETURN_IF_ERROR(acting_->Assign(policy));
  } else {
    B4MRL_ASSIGN_OR_RETURN(acting_, FixedOrderPolicy::Create(policy));
  }
  for (uint64_t step = 0; step < steps; step += count_) {
    B4MRL_RETURN_IF_ERROR(Step(*acting_, metrics));
  }
  return Status();
}

Status ReplayCollector::KeepSession() {
  if (!IsDueAgain(*context_->client, asked_)) return Status();
  asked_ = Clock::now();
  constexpr std::array<uint32_t, 1> kFirstLane = {0};
  return simulator_.Snapshot(kFirstLane).status();
}

void ReplayCollector::Explore(const FixedOrderPolicy& policy) {
  Rng rng(RoleSeed(context_->seed, "explore"), "actions", vector_steps_);
  rng.FillNormal(noise_.values());
  if (policy.stochastic()) return policy.Sample(histories_.view(), noise_.view(), actions_.view());
  policy.Act(histories_.view(), actions_.view());
  std::transform(actions_.values().begin(), actions_.values().end(), noise_.values().begin(),
                 actions_.values().begin(), [&](float action, float noise) {
                   return std::clamp(action + exploration_noise_ * noise, -1.0f, 1.0f);
                 });
}

Result<StepOutcome> ReplayCollector::StepAndStore() {
  for (uint32_t lane = 0; lane < count_; ++lane) {
    for (int i = 0; i < context_->action_size(); ++i) {
      scaled_actions_.view()(i, lane) = actions_.view()(i, lane) * action_scale_[i];
    }
  }
  B4MRL_ASSIGN_OR_RETURN(
      StepOutcome outcome,
      UntilTaken([&] { return simulator_.Step(scaled_actions_.values()); }, *context_->stop));
  asked_ = Clock::now();
  ++vector_steps_;
  size_t ended = 0;  // position in final_lanes, which are in order
  for (uint32_t lane = 0; lane < count_; ++lane) {
    std::span<const float> final_observation;
    if (ended < outcome.final_lanes.size() && outcome.final_lanes[ended] == lane) {
      final_observation = RowOf(outcome.final_observations, ended++);
    }
    B4MRL_RETURN_IF_ERROR(Store(static_cast<int>(lane), outcome, final_observation));
  }
  return outcome;
}

Status ReplayCollector::Store(int lane, const StepOutcome& outcome,
                              std::span<const float> final_observation) {
  const std::span<const float> observation = RowOf(outcome.observations, lane);
  const bool ended = !final_observation.empty();
  const std::span<const float> stacked = histories_.lane(lane);
  std::copy(stacked.begin(), stacked.end(), previous_.begin());
  histories_.Push(lane, Visible(ended ? final_observation : observation));

  if (!outcome.given_up(lane)) {
    const float* action = actions_.view().column(lane);
    B4MRL_RETURN_IF_ERROR(
        replay_->Append({.observation = previous_,
                         .action = {action, static_cast<size_t>(context_->action_size())},
                         .next_observation = histories_.lane(lane),
                         .reward = static_cast<float>(outcome.rewards[lane]),
                         .terminated = outcome.terminated[lane] != 0}));
  }
  if (ended) histories_.Reset(lane, Visible(observation));
  return Status();
}

std::span<const float> ReplayCollector::Visible(std::span<const float> observation) {
  if (mask_.empty()) return observation;
  std::transform(observation.begin(), observation.end(), mask_.begin(), visible_.begin(),
                 [](float value, float seen) { return seen == 0 ? 0 : value; });
  return visible_;
}

PolicyWeights ReplayCollector::WithInputs(PolicyWeights policy) const {
  policy.observation_mask.clear();
  for (uint32_t i = 0; i < context_->history_length; ++i) {
    policy.observation_mask.insert(policy.observation_mask.end(), mask_.begin(), mask_.end());
  }
  return policy;
}

Status ReplayCollector::Save(CheckpointWriter& writer) {
  B4MRL_RETURN_IF_ERROR(replay_->Sync());
  B4MRL_ASSIGN_OR_RETURN(const LaneStates states, simulator_.Snapshot());
  writer.Bytes("lanes/snapshot", states.snapshot);
  writer.Floats("lanes/histories", histories_.values());
  writer.Unsigned("lanes/vector_steps", vector_steps_);
  writer.Unsigned("lanes/warm_up_steps", warm_up_steps_);
  writer.Unsigned("lanes/replay_length", replay_->length());
  return Status();
}

Status ReplayCollector::Load(CheckpointReader& reader) {
  LaneStates states;
  states.lanes = count_;
  states.snapshot = reader.Bytes("lanes/snapshot");
  reader.FloatsInto("lanes/histories", histories_.values());
  vector_steps_ = reader.Unsigned("lanes/vector_steps");
  // Checkpoints of older program versions lack this number; with 0, no episode is left out.
  warm_up_steps_ = reader.Has("lanes/warm_up_steps") ? reader.Unsigned("lanes/warm_up_steps") : 0;
  const uint64_t length = reader.Unsigned("lanes/replay_length");
  B4MRL_RETURN_IF_ERROR(reader.status());
  B4MRL_ASSIGN_OR_RETURN(ReplayBuffer replay,
                         ReplayBuffer::ResumeFile(ReplayPath(), replay_options_, length));
  replay_.emplace(std::move(replay));
  return simulator_.Restore(states).status();
}

}  // namespace b4mrl
