#include "algorithms/episodes/collect.h"

#include <algorithm>
#include <array>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/policy/observation_history.h"
#include "client/remote_environment.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

constexpr size_t kGroups = 2;

// The rows of one episode so far.
struct Trajectory {
  uint64_t rows() const { return rewards.size(); }
  DatasetRows view(uint64_t limit) const {
    const size_t count = std::min<uint64_t>(rows(), limit);
    const auto part = [&](const auto& values) {
      return std::span(values).first(values.size() / rows() * count);
    };
    DatasetRows out;
    out.rows = count;
    out.observations = part(observations);
    out.actions = part(actions);
    out.next_observations = part(next_observations);
    out.rewards = part(rewards);
    out.terminals = part(terminals);
    out.timeouts = part(timeouts);
    out.action_log_probs = part(log_probs);
    return out;
  }

  uint64_t episode = 0;
  double episode_return = 0;
  std::vector<float> observations, actions, next_observations, rewards, log_probs;
  std::vector<uint8_t> terminals, timeouts;
};

// One lane: the episode that it runs, and the inputs of its next action.
struct Lane {
  std::optional<Trajectory> trajectory;  // without a value the lane is idle
  std::optional<Rng> noise;
  std::vector<float> observation;
};

// Lanes that are stepped by one request.
struct Group {
  std::vector<uint32_t> lanes;  // the group's lanes that run an episode
  MatrixBuffer<float> actions;
  std::vector<float> log_probs;
  uint64_t request = 0;
};

class Collector {
 public:
  Collector(const CollectOptions& options, const AgentPolicy& policy, RemoteEnvironment session,
            DatasetWriter& writer, Progress& progress)
      : options_(options),
        policy_(policy),
        session_(std::move(session)),
        writer_(writer),
        progress_(progress),
        lanes_(session_.num_envs()),
        histories_(policy.history_length(), policy.observation_size(),
                   static_cast<int>(lanes_.size())) {}

  Result<CollectSummary> Run();

 private:
  bool NeedsAnotherEpisode() const;
  Status StartEpisodes(std::span<const uint32_t> lanes);
  Status SendStep(Group& group);
  Status ReceiveStep();
  Result<bool> StoreStep(Group& group, const StepOutcome& outcome, size_t position);
  Status WriteFinished();

  const CollectOptions& options_;
  const AgentPolicy& policy_;
  RemoteEnvironment session_;
  DatasetWriter& writer_;
  Progress& progress_;
  std::vector<Lane> lanes_;
  ObservationHistory histories_;
  std::array<Group, kGroups> groups_;
  uint64_t next_episode_ = 0;
  std::map<uint64_t, Trajectory> finished_;  // not written yet, because an earlier one is not
  CollectSummary summary_;
  double return_sum_ = 0;
};

Result<CollectSummary> Collector::Run() {
  progress_.Start("make dataset", "rows", options_.rows);
  const auto lanes = static_cast<uint32_t>(lanes_.size());
  for (uint32_t g = 0; g < kGroups; ++g) {
    Group& group = groups_[g];
    for (uint32_t lane = g; lane < lanes; lane += kGroups) group.lanes.push_back(lane);
    B4MRL_RETURN_IF_ERROR(StartEpisodes(group.lanes));
    B4MRL_RETURN_IF_ERROR(SendStep(group));
  }
  while (summary_.rows < options_.rows) B4MRL_RETURN_IF_ERROR(ReceiveStep());
  progress_.Finish();
  if (summary_.whole_episodes > 0) {
    summary_.mean_return = return_sum_ / static_cast<double>(summary_.whole_episodes);
  }
  return summary_;
}

// Whether to start another episode: only if the episodes under way could not give enough rows even
// if each reached the step limit. An episode's rows do not depend on this choice.
bool Collector::NeedsAnotherEpisode() const {
  uint64_t expected = summary_.rows;
  for (const auto& [episode, trajectory] : finished_) expected += trajectory.rows();
  for (const Lane& lane : lanes_) {
    if (lane.trajectory) expected += session_.spec().max_episode_steps;
  }
  return expected < options_.rows;
}

Status Collector::StartEpisodes(std::span<const uint32_t> candidates) {
  std::vector<uint32_t> started;
  std::vector<uint64_t> seeds;
  for (const uint32_t index : candidates) {
    Lane& lane = lanes_[index];
    lane.trajectory.reset();
    if (!NeedsAnotherEpisode()) continue;
    const uint64_t episode = next_episode_++;
    lane.trajectory.emplace();
    lane.trajectory->episode = episode;
    lane.noise.emplace(RoleSeed(options_.seed, "behaviour", episode), "actions");
    started.push_back(index);
    seeds.push_back(RoleSeed(options_.seed, "episode", episode));
  }
  if (started.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, session_.Reset(started, seeds));
  for (size_t i = 0; i < started.size(); ++i) {
    const std::span<const float> observation = RowOf(first.observations, i);
    lanes_[started[i]].observation.assign(observation.begin(), observation.end());
    histories_.Reset(static_cast<int>(started[i]), observation);
  }
  return Status();
}

Status Collector::SendStep(Group& group) {
  std::erase_if(group.lanes, [&](uint32_t lane) { return !lanes_[lane].trajectory; });
  group.request = 0;
  if (group.lanes.empty()) return Status();
  const int count = static_cast<int>(group.lanes.size());
  MatrixBuffer<float> inputs(policy_.history_length() * policy_.observation_size(), count);
  MatrixBuffer<float> noise(policy_.action_size(), count);
  group.actions = MatrixBuffer<float>(policy_.action_size(), count);
  group.log_probs.resize(group.lanes.size());
  for (int i = 0; i < count; ++i) {
    const std::span<const float> history = histories_.lane(static_cast<int>(group.lanes[i]));
    std::copy(history.begin(), history.end(), inputs.view().column(i));
    const std::span<float> draws(noise.view().column(i), static_cast<size_t>(noise.rows()));
    lanes_[group.lanes[i]].noise->FillNormal(draws);
  }
  policy_.Sample(inputs.view(), noise.view(), group.actions.view(), group.log_probs);
  B4MRL_ASSIGN_OR_RETURN(group.request, session_.Send(group.actions.values(), group.lanes));
  return Status();
}

Status Collector::ReceiveStep() {
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, session_.Receive());
  const auto group = std::find_if(groups_.begin(), groups_.end(),
                                  [&](const Group& g) { return g.request == outcome.request_id; });
  if (group == groups_.end()) {
    return Status(StatusCode::kInternal, "an answer to a step that was not asked for");
  }
  std::vector<uint32_t> ended;
  for (size_t i = 0; i < group->lanes.size(); ++i) {
    B4MRL_ASSIGN_OR_RETURN(const bool episode_ended, StoreStep(*group, outcome, i));
    if (episode_ended) ended.push_back(group->lanes[i]);
  }
  B4MRL_RETURN_IF_ERROR(WriteFinished());
  B4MRL_RETURN_IF_ERROR(StartEpisodes(ended));
  return SendStep(*group);
}

// Returns whether the lane's episode ended; its trajectory has then moved to `finished_`.
Result<bool> Collector::StoreStep(Group& group, const StepOutcome& outcome, size_t position) {
  Lane& lane = lanes_[group.lanes[position]];
  Trajectory& rows = *lane.trajectory;
  if (outcome.given_up(position)) {
    return Status(StatusCode::kFailedPrecondition,
                  "the simulator gave up a step; no dataset is made of such episodes");
  }
  const std::span<const float> next = RowOf(outcome.observations, position);
  const float* action = group.actions.view().column(static_cast<int>(position));
  rows.observations.insert(rows.observations.end(), lane.observation.begin(),
                           lane.observation.end());
  rows.actions.insert(rows.actions.end(), action, action + group.actions.rows());
  rows.next_observations.insert(rows.next_observations.end(), next.begin(), next.end());
  rows.rewards.push_back(static_cast<float>(outcome.rewards[position]));
  rows.log_probs.push_back(group.log_probs[position]);
  rows.terminals.push_back(outcome.terminated[position]);
  const bool timeout = outcome.truncated[position] != 0 && outcome.terminated[position] == 0;
  rows.timeouts.push_back(timeout ? 1 : 0);
  rows.episode_return += outcome.rewards[position];
  lane.observation.assign(next.begin(), next.end());
  histories_.Push(static_cast<int>(group.lanes[position]), next);
  if (outcome.terminated[position] == 0 && outcome.truncated[position] == 0) return false;
  const uint64_t episode = rows.episode;
  finished_.emplace(episode, std::move(rows));
  lane.trajectory.reset();
  return true;
}

Status Collector::WriteFinished() {
  while (!finished_.empty() && finished_.begin()->first == summary_.episodes &&
         summary_.rows < options_.rows) {
    const Trajectory& trajectory = finished_.begin()->second;
    const DatasetRows rows = trajectory.view(options_.rows - summary_.rows);
    B4MRL_RETURN_IF_ERROR(writer_.Append(rows));
    summary_.rows += rows.rows;
    ++summary_.episodes;
    if (rows.rows == trajectory.rows()) {
      ++summary_.whole_episodes;
      return_sum_ += trajectory.episode_return;
    }
    finished_.erase(finished_.begin());
  }
  progress_.Update(summary_.rows);
  return Status();
}

// The number of lanes, at most `lanes_max` per group: episodes run in waves of about equal size, so
// that all lanes stay busy to the end.
uint32_t LaneCount(const CollectOptions& options, const EnvironmentSpec& environment) {
  const uint64_t steps = std::max<uint64_t>(environment.max_episode_steps, 1);
  const uint64_t episodes = (options.rows + steps - 1) / steps;
  const uint64_t most = kGroups * options.lanes_max;
  const uint64_t waves = (episodes + most - 1) / most;
  return static_cast<uint32_t>(std::max<uint64_t>((episodes + waves - 1) / waves, 1));
}

}  // namespace

Result<CollectSummary> Collect(const CollectOptions& options, const AgentPolicy& policy,
                               Client& client, DatasetWriter& writer, Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec environment,
                         client.FindEnvironment(options.environment));
  if (static_cast<size_t>(policy.observation_size()) != environment.observation.size() ||
      static_cast<size_t>(policy.action_size()) != environment.action.size()) {
    return InvalidArgument("agent", "one of another size", "an agent for " + environment.name);
  }
  if (!policy.stochastic()) {
    return InvalidArgument("agent", "deterministic", "a stochastic policy (tanh_gaussian)");
  }
  EnvironmentOptions session_options;
  session_options.num_envs = LaneCount(options, environment);
  session_options.seed = options.seed;  // each episode then has its own seed, given by Reset
  session_options.autoreset_mode = AutoresetMode::kDisabled;
  session_options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client.Make(environment.name, session_options));
  Collector collector(options, policy, std::move(session), writer, progress);
  return collector.Run();
}

}  // namespace b4mrl
