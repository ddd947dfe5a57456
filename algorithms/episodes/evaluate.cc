#include "algorithms/episodes/evaluate.h"

#include <fmt/format.h>

#include <numeric>
#include <span>

#include "algorithms/base/learner.h"
#include "algorithms/base/metrics.h"
#include "algorithms/episodes/behaviour.h"
#include "algorithms/policy/observation_history.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

// The lanes whose episode still runs, and a matrix of their stacked observations.
class OpenEpisodes {
 public:
  OpenEpisodes(const AgentPolicy& policy, int lanes)
      : histories_(policy.history_length(), policy.observation_size(), lanes),
        inputs_(policy.history_length() * policy.observation_size(), lanes),
        lanes_(lanes) {
    std::iota(lanes_.begin(), lanes_.end(), 0u);
  }

  std::span<const uint32_t> lanes() const { return lanes_; }
  int size() const { return static_cast<int>(lanes_.size()); }
  void Reset(uint32_t lane, std::span<const float> observation) {
    histories_.Reset(static_cast<int>(lane), observation);
  }
  void Push(uint32_t lane, std::span<const float> observation) {
    histories_.Push(static_cast<int>(lane), observation);
  }
  void SetOpen(std::vector<uint32_t> lanes) { lanes_ = std::move(lanes); }
  MatrixView<const float> Inputs() {
    for (int i = 0; i < size(); ++i) {
      const auto history = histories_.lane(static_cast<int>(lanes_[i]));
      std::copy(history.begin(), history.end(), inputs_.view().column(i));
    }
    return inputs_.view(size());
  }

 private:
  ObservationHistory histories_;
  MatrixBuffer<float> inputs_;
  std::vector<uint32_t> lanes_;
};

void Summarise(const EnvironmentSpec& environment, EvaluationResult& result) {
  const MeanAndStd figures = MeanAndStdOf(result.returns);
  result.mean_return = figures.mean;
  result.std_return = figures.std;
  result.score = environment.NormalisedScore(result.mean_return);
}

}  // namespace

Result<Evaluator> Evaluator::Open(Client& client, const std::string& environment,
                                  const std::vector<NamedArgument>& perturbations,
                                  uint32_t episodes, uint64_t seed) {
  EnvironmentOptions options;
  options.simulator = perturbations;
  options.num_envs = episodes;
  options.seed = seed;  // each Reset then gives every lane its own seed
  options.autoreset_mode = AutoresetMode::kDisabled;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_RETURN_IF_ERROR(client.Make(environment, options).status());
  return Evaluator(&client, environment, std::move(options), seed);
}

Result<EvaluationResult> Evaluator::Run(const AgentPolicy& policy, const Watcher& watch) {
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client_->Make(environment_, options_));
  B4MRL_RETURN_IF_ERROR(CheckSizes(policy, session.spec()));
  const uint32_t episodes = options_.num_envs;
  EvaluationResult result;
  result.returns.resize(episodes);
  result.lengths.resize(episodes);
  std::vector<uint64_t> seeds;
  for (uint32_t i = 0; i < episodes; ++i) seeds.push_back(RoleSeed(seed_, "evaluation", i));

  OpenEpisodes open(policy, static_cast<int>(episodes));
  MatrixBuffer<float> actions(policy.action_size(), static_cast<int>(episodes));
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, session.Reset({}, seeds));
  for (uint32_t i = 0; i < episodes; ++i) open.Reset(i, RowOf(first.observations, i));
  if (watch) B4MRL_RETURN_IF_ERROR(watch(session));
  while (open.size() > 0) {
    const MatrixView<float> now = actions.view(open.size());
    policy.Act(open.Inputs(), now);
    const std::span<const float> flat(now.data, static_cast<size_t>(now.rows) * now.columns);
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, session.Step(flat, open.lanes()));
    if (watch && open.lanes().front() == 0) B4MRL_RETURN_IF_ERROR(watch(session));
    std::vector<uint32_t> still_open;
    for (int i = 0; i < open.size(); ++i) {
      const uint32_t lane = open.lanes()[i];
      result.returns[lane] += outcome.rewards[i];
      ++result.lengths[lane];
      result.given_up += outcome.given_up(i) ? 1 : 0;
      if (outcome.terminated[i] || outcome.truncated[i]) continue;
      open.Push(lane, RowOf(outcome.observations, i));
      still_open.push_back(lane);
    }
    open.SetOpen(std::move(still_open));
  }
  Summarise(session.spec(), result);
  return result;
}

void SaveEvaluation(CheckpointWriter& writer, const std::string& name,
                    const EvaluationResult& result) {
  writer.Unsigned(name + "/episodes", result.returns.size());
  for (size_t i = 0; i < result.returns.size(); ++i) {
    writer.Number(fmt::format("{}/return{}", name, i), result.returns[i]);
    writer.Unsigned(fmt::format("{}/length{}", name, i), result.lengths[i]);
  }
  writer.Number(name + "/mean_return", result.mean_return);
  writer.Number(name + "/std_return", result.std_return);
  writer.Integer(name + "/has_score", result.score ? 1 : 0);
  writer.Number(name + "/score", result.score.value_or(0));
  writer.Unsigned(name + "/given_up", result.given_up);
}

EvaluationResult LoadEvaluation(CheckpointReader& reader, const std::string& name) {
  EvaluationResult result;
  const uint64_t episodes = reader.Unsigned(name + "/episodes");
  for (uint64_t i = 0; i < episodes && reader.status().ok(); ++i) {
    result.returns.push_back(reader.Number(fmt::format("{}/return{}", name, i)));
    result.lengths.push_back(
        static_cast<uint32_t>(reader.Unsigned(fmt::format("{}/length{}", name, i))));
  }
  result.mean_return = reader.Number(name + "/mean_return");
  result.std_return = reader.Number(name + "/std_return");
  const bool has_score = reader.Integer(name + "/has_score") != 0;
  const double score = reader.Number(name + "/score");
  if (has_score) result.score = score;
  if (reader.Has(name + "/given_up")) {
    result.given_up = static_cast<uint32_t>(reader.Unsigned(name + "/given_up"));
  }
  return result;
}

}  // namespace b4mrl
