#include "tests/integration/support/lane_walk.h"

#include <algorithm>
#include <numeric>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr size_t kActions = 6;

template <typename T>
void Append(std::string* bytes, const T& value) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(value));
}

void AppendRow(std::string* bytes, const TensorView& view, size_t row) {
  const size_t row_bytes = view.bytes() / view.rows();
  bytes->append(reinterpret_cast<const char*>(view.data) + row * row_bytes, row_bytes);
}

}  // namespace

LaneWalk::LaneWalk(RemoteEnvironment environment, uint32_t groups, uint32_t lanes_per_group)
    : environment_(std::move(environment)),
      lanes_per_group_(lanes_per_group),
      sent_(groups),
      finished_(groups),
      records_(groups * lanes_per_group),
      causes_(groups * lanes_per_group) {}

Result<LaneWalk> LaneWalk::Open(Client& client, uint32_t groups, uint32_t lanes_per_group,
                                uint64_t seed) {
  EnvironmentOptions options;
  options.num_envs = groups * lanes_per_group;
  options.seed = seed;
  options.simulator = {{"gravity", "1.5"}, {"obs-noise", "0.02"}};
  options.config = R"({"max_episode_steps": 40})";
  options.deadline_ms = 60'000;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment, client.Make("HalfCheetah", options));
  return LaneWalk(std::move(environment), groups, lanes_per_group);
}

std::vector<uint32_t> LaneWalk::LanesOf(uint32_t group) const {
  std::vector<uint32_t> lanes(lanes_per_group_);
  std::iota(lanes.begin(), lanes.end(), group * lanes_per_group_);
  return lanes;
}

Status LaneWalk::Reset() { return environment_.Reset().status(); }

Status LaneWalk::SendStep(uint32_t group) {
  const std::vector<uint32_t> lanes = LanesOf(group);
  std::vector<float> actions;
  for (const uint32_t lane : lanes) {
    Rng rng(lane, "walk", sent_[group]);
    for (size_t i = 0; i < kActions; ++i) {
      actions.push_back(static_cast<float>(rng.Uniform(-1, 1)));
    }
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id,
                         environment_.Send(std::span<const float>(actions), lanes));
  group_of_request_[id] = group;
  ++sent_[group];
  return Status();
}

void LaneWalk::Record(uint32_t group, const StepOutcome& outcome) {
  for (uint32_t row = 0; row < lanes_per_group_; ++row) {
    const uint32_t lane = group * lanes_per_group_ + row;
    std::string bytes;
    AppendRow(&bytes, outcome.observations, row);
    Append(&bytes, outcome.rewards[row]);
    Append(&bytes, outcome.terminated[row]);
    Append(&bytes, outcome.truncated[row]);
    Append(&bytes, outcome.causes[row]);
    Append(&bytes, outcome.digests[row]);
    for (size_t i = 0; i < outcome.final_lanes.size(); ++i) {
      if (outcome.final_lanes[i] != row) continue;
      AppendRow(&bytes, outcome.final_observations, i);
      Append(&bytes, outcome.final_returns[i]);
      Append(&bytes, outcome.final_lengths[i]);
    }
    records_[lane].push_back(std::move(bytes));
    causes_[lane].push_back(outcome.causes[row]);
  }
}

Status LaneWalk::ReceiveOne(uint32_t* group) {
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, environment_.Receive());
  const auto found = group_of_request_.find(outcome.request_id);
  if (found == group_of_request_.end()) {
    return Status(StatusCode::kInternal, "a reply to a request that was not in flight");
  }
  *group = found->second;
  group_of_request_.erase(found);
  Record(*group, outcome);
  ++finished_[*group];
  return Status();
}

Status LaneWalk::Advance() {
  if (group_of_request_.empty()) {
    for (uint32_t group = 0; group < sent_.size(); ++group) {
      B4MRL_RETURN_IF_ERROR(SendStep(group));
    }
  }
  uint32_t group = 0;
  B4MRL_RETURN_IF_ERROR(ReceiveOne(&group));
  return SendStep(group);
}

Status LaneWalk::Drain() {
  uint32_t group = 0;
  while (!group_of_request_.empty()) B4MRL_RETURN_IF_ERROR(ReceiveOne(&group));
  return Status();
}

Status LaneWalk::RunTo(uint64_t steps) {
  B4MRL_RETURN_IF_ERROR(Drain());
  for (uint32_t group = 0; group < sent_.size(); ++group) {
    if (sent_[group] < steps) B4MRL_RETURN_IF_ERROR(SendStep(group));
  }
  while (!group_of_request_.empty()) {
    uint32_t group = 0;
    B4MRL_RETURN_IF_ERROR(ReceiveOne(&group));
    if (sent_[group] < steps) B4MRL_RETURN_IF_ERROR(SendStep(group));
  }
  return Status();
}

uint64_t LaneWalk::FinishedSteps() const {
  return *std::min_element(finished_.begin(), finished_.end());
}

std::string LaneWalk::Bytes(uint32_t lane, uint64_t steps) const {
  std::string all;
  for (uint64_t step = 0; step < std::min<uint64_t>(steps, records_[lane].size()); ++step) {
    all += records_[lane][step];
  }
  return all;
}

uint64_t LaneWalk::Hash(uint64_t steps) const {
  uint64_t hash = 0;
  for (uint32_t lane = 0; lane < records_.size(); ++lane) {
    hash = MixSeeds(hash, HashName(Bytes(lane, steps)));
  }
  return hash;
}

}  // namespace b4mrl
