#include "client/evaluation.h"

#include "proto/base/mean_and_std.h"
#include "proto/base/role_seed.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

// The episodes that have not ended, with their last observations.
struct OpenEpisodes {
  std::vector<uint32_t> lanes;
  std::vector<float> observations;  // lanes x observation size

  void Add(uint32_t lane, std::span<const float> observation) {
    lanes.push_back(lane);
    observations.insert(observations.end(), observation.begin(), observation.end());
  }
};

// Adds a step of `open` to the result. Returns the episodes that go on.
OpenEpisodes Advance(const OpenEpisodes& open, const StepOutcome& outcome,
                     EvaluationResult* result) {
  OpenEpisodes still_open;
  for (size_t i = 0; i < open.lanes.size(); ++i) {
    const uint32_t lane = open.lanes[i];
    result->returns[lane] += outcome.rewards[i];
    ++result->lengths[lane];
    result->given_up += outcome.given_up(i) ? 1 : 0;
    if (outcome.terminated[i] || outcome.truncated[i]) continue;
    still_open.Add(lane, RowOf(outcome.observations, i));
  }
  return still_open;
}

}  // namespace

Result<EvaluationResult> PlayEpisodes(RemoteEnvironment& session, uint64_t seed,
                                      const BatchPolicy& policy, const EpisodeWatcher& watch) {
  const uint32_t episodes = session.num_envs();
  const size_t action_size = session.spec().action.size();
  EvaluationResult result;
  result.returns.resize(episodes);
  result.lengths.resize(episodes);
  std::vector<uint64_t> seeds;
  for (uint32_t i = 0; i < episodes; ++i) seeds.push_back(RoleSeed(seed, "evaluation", i));

  OpenEpisodes open;
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, session.Reset({}, seeds));
  for (uint32_t i = 0; i < episodes; ++i) open.Add(i, RowOf(first.observations, i));
  if (watch) B4MRL_RETURN_IF_ERROR(watch(session));
  std::vector<float> buffer(episodes * action_size);
  for (uint32_t step = 0; !open.lanes.empty(); ++step) {
    const auto actions = std::span(buffer).first(open.lanes.size() * action_size);
    B4MRL_RETURN_IF_ERROR(policy({step, open.lanes, open.observations, actions}));
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome,
                           session.Step(std::span<const float>(actions), open.lanes));
    if (watch && open.lanes.front() == 0) B4MRL_RETURN_IF_ERROR(watch(session));
    open = Advance(open, outcome, &result);
  }
  const MeanAndStd figures = MeanAndStdOf(result.returns);
  result.mean_return = figures.mean;
  result.std_return = figures.std;
  result.score = session.spec().NormalisedScore(figures.mean);
  return result;
}

}  // namespace b4mrl
