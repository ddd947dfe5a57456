#include "algorithms/episodes/collect.h"

#include <algorithm>
#include <array>
#include <map>
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
  Collector(const CollectOptions& options, const Behaviour& behaviour, RemoteEnvironment session,
            Recorder& recorder, Progress& progress)
      : options_(options),
        behaviour_(behaviour),
        session_(std::move(session)),
        recorder_(recorder),
        progress_(progress),
        lanes_(session_.num_envs()),
        histories_(behaviour.history_length(), behaviour.observation_size(),
                   static_cast<int>(lanes_.size())) {}

  Status Run();

 private:
  bool NeedsAnotherEpisode() const;
  Status StartEpisodes(std::span<const uint32_t> lanes);
  Status SendStep(Group& group);
  Status ReceiveStep();
  Result<bool> StoreStep(Group& group, const StepOutcome& outcome, size_t position);
  Status WriteFinished();

  const CollectOptions& options_;
  const Behaviour& behaviour_;
  RemoteEnvironment session_;
  Recorder& recorder_;
  Progress& progress_;
  std::vector<Lane> lanes_;
  ObservationHistory histories_;
  std::array<Group, kGroups> groups_;
  uint64_t next_episode_ = 0;                // to be started
  std::map<uint64_t, Trajectory> finished_;  // not written yet, because an earlier one is not
  uint64_t written_episodes_ = 0;
  uint64_t rows_ = 0;  // written
  bool done_ = false;
};

Status Collector::Run() {
  progress_.Start("make dataset", "rows", options_.rows);
  const auto lanes = static_cast<uint32_t>(lanes_.size());
  for (uint32_t g = 0; g < kGroups; ++g) {
    Group& group = groups_[g];
    for (uint32_t lane = g; lane < lanes; lane += kGroups) group.lanes.push_back(lane);
    B4MRL_RETURN_IF_ERROR(StartEpisodes(group.lanes));
    B4MRL_RETURN_IF_ERROR(SendStep(group));
  }
  while (!done_) B4MRL_RETURN_IF_ERROR(ReceiveStep());
  progress_.Finish();
  return Status();
}

// Whether to start another episode: only if the episodes under way could not give enough rows even
// if each reached the step limit. An episode's rows do not depend on this choice.
bool Collector::NeedsAnotherEpisode() const {
  uint64_t expected = rows_;
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
    seeds.push_back(EpisodeSeed(options_.seed, episode));
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
  MatrixBuffer<float> inputs(behaviour_.history_length() * behaviour_.observation_size(), count);
  MatrixBuffer<float> draws(behaviour_.action_size(), count);
  group.actions = MatrixBuffer<float>(behaviour_.action_size(), count);
  group.log_probs.resize(group.lanes.size());
  for (int i = 0; i < count; ++i) {
    const std::span<const float> history = histories_.lane(static_cast<int>(group.lanes[i]));
    std::copy(history.begin(), history.end(), inputs.view().column(i));
    behaviour_.Draw(*lanes_[group.lanes[i]].noise,
                    {draws.view().column(i), static_cast<size_t>(draws.rows())});
  }
  behaviour_.Act(inputs.view(), draws.view(), group.actions.view(), group.log_probs);
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
  rows.timeouts.push_back(outcome.timed_out(position) ? 1 : 0);
  lane.observation.assign(next.begin(), next.end());
  histories_.Push(static_cast<int>(group.lanes[position]), next);
  if (outcome.terminated[position] == 0 && outcome.truncated[position] == 0) return false;
  const uint64_t episode = rows.episode;
  finished_.emplace(episode, std::move(rows));
  lane.trajectory.reset();
  return true;
}

Status Collector::WriteFinished() {
  while (!done_ && !finished_.empty() && finished_.begin()->first == written_episodes_) {
    const Trajectory& trajectory = finished_.begin()->second;
    const uint64_t room = options_.rows - rows_;
    const bool fits = trajectory.rows() <= room;
    done_ = trajectory.rows() >= room;
    if (fits || !options_.whole_episodes) {
      const DatasetRows rows = trajectory.view(room);
      B4MRL_RETURN_IF_ERROR(recorder_.Append(rows));
      rows_ += rows.rows;
    }
    ++written_episodes_;
    finished_.erase(finished_.begin());
  }
  progress_.Update(rows_);
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

uint64_t EpisodeSeed(uint64_t seed, uint64_t episode) { return RoleSeed(seed, "episode", episode); }

Status Collect(const CollectOptions& options, const Behaviour& behaviour, Client& client,
               Recorder& recorder, Progress& progress) {
  if (options.rows == 0) return Status();
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec environment,
                         client.FindEnvironment(options.environment));
  EnvironmentOptions session_options;
  session_options.simulator = options.simulator;
  session_options.num_envs = LaneCount(options, environment);
  session_options.seed = SessionSeed(options.seed, session_options.num_envs);
  session_options.autoreset_mode = AutoresetMode::kDisabled;
  session_options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client.Make(environment.name, session_options));
  Collector collector(options, behaviour, std::move(session), recorder, progress);
  return collector.Run();
}

}  // namespace b4mrl
