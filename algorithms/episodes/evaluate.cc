#include "algorithms/episodes/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "algorithms/base/learner.h"
#include "algorithms/episodes/behaviour.h"
#include "algorithms/nn/products/view.h"
#include "algorithms/policy/observation_history.h"

namespace b4mrl {
namespace {

// An agent as a policy of batches, with the observations that it remembers.
class RememberingPolicy {
 public:
  RememberingPolicy(const AgentPolicy& policy, int episodes)
      : policy_(policy),
        histories_(policy.history_length(), policy.observation_size(), episodes),
        inputs_(policy.history_length() * policy.observation_size(), episodes) {}

  Status operator()(const PolicyBatch& batch) {
    const auto size = static_cast<size_t>(policy_.observation_size());
    const int rows = static_cast<int>(batch.episodes.size());
    for (int i = 0; i < rows; ++i) {
      const int episode = static_cast<int>(batch.episodes[static_cast<size_t>(i)]);
      const auto observation = batch.observations.subspan(static_cast<size_t>(i) * size, size);
      if (batch.step == 0) {
        histories_.Reset(episode, observation);
      } else {
        histories_.Push(episode, observation);
      }
      std::ranges::copy(histories_.lane(episode), inputs_.view().column(i));
    }
    policy_.Act(inputs_.view(rows), {batch.actions.data(), policy_.action_size(), rows});
    return Status();
  }

 private:
  const AgentPolicy& policy_;
  ObservationHistory histories_;
  MatrixBuffer<float> inputs_;
};

}  // namespace

Result<Evaluator> Evaluator::Open(Client& client, const std::string& environment,
                                  const std::vector<NamedArgument>& perturbations,
                                  uint32_t episodes, uint64_t seed) {
  EnvironmentOptions options;
  options.simulator = perturbations;
  options.num_envs = episodes;
  options.seed = SessionSeed(seed, episodes);
  options.autoreset_mode = AutoresetMode::kDisabled;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_RETURN_IF_ERROR(client.Make(environment, options).status());
  return Evaluator(&client, environment, std::move(options), seed);
}

Result<EvaluationResult> Evaluator::Run(const AgentPolicy& policy, const EpisodeWatcher& watch) {
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client_->Make(environment_, options_));
  B4MRL_RETURN_IF_ERROR(CheckSizes(policy, session.spec()));
  RememberingPolicy remembering(policy, static_cast<int>(options_.num_envs));
  return PlayEpisodes(session, seed_, std::ref(remembering), watch);
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
