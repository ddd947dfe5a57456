// BC: behaviour cloning, offline. The usual baseline of offline learners, and the example of
// CONTRIBUTING.md's "Add an algorithm".
//
//   D   dataset of (s, a, r, s', d), as the daemon serves it, with corruptions if asked for
//   pi  deterministic actor: tanh of a network
//
//   normalise:  s <- (s - mean) / (std + 0.001), mean and std over D's observations
//   repeat:     a batch from D; one step of Adam on  mean (pi(s) - a)^2,
//               the mean over the batch and the action's dimensions
//
// Papers clone in several ways. This learner is TD3-BC (learners/td3_bc.cc) without its critics: it
// has the same loss, network, initial weights, normaliser and defaults, with a step of the actor in
// every update. So BC's and TD3-BC's scores differ by what the critics add.
#include <algorithm>
#include <memory>
#include <utility>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/learners/core_options.h"
#include "algorithms/learners/offline_learner.h"
#include "algorithms/nn/losses.h"
#include "algorithms/nn/network.h"
#include "algorithms/nn/squashed_gaussian.h"

namespace b4mrl {
namespace {

constexpr std::string_view kSource = "ours: TD3-BC's, so that the two differ by the value alone";

struct BcMetrics {
  double loss = 0;
};

void AddMetrics(const BcMetrics& metrics, MetricMeans& means) {
  means.Add("bc_loss", metrics.loss);
}

// The actor and its gradient step. Thread rule: one thread.
class BcCore : public TrainedParts<BcCore, float> {
 public:
  explicit BcCore(const ActorCriticOptions& options)
      : action_size_(options.action_size),
        actor_({.shape = ActorShape(options, options.action_size),
                .learning_rate = options.actor_learning_rate,
                .batch_max = options.batch_max,
                .precision = options.precision,
                .weights = {Rng(options.seed, "td3-actor-weights")}}),  // as TD3-BC draws them
        actions_(options.action_size, options.batch_max),
        gradient_(options.action_size, options.batch_max) {}

  // One gradient step; returns the loss before the step.
  BcMetrics Update(const TransitionBatch<float>& batch) {
    const MatrixView<float> actions = actions_.view(batch.size());
    const MatrixView<float> gradient = gradient_.view(batch.size());
    TanhForward<float>(actor_.Forward(batch.observations), actions);
    std::ranges::fill(gradient.values(), 0.0f);
    const double loss = AddMeanSquaredError<float>(actions, batch.actions, gradient);
    TanhBackward<float>(actions, gradient, actor_.workspace.output_gradient());
    actor_.Backward(batch.observations);
    actor_.Step();
    ++updates_;
    return {loss};
  }

  int64_t updates() const { return updates_; }
  PolicyWeights Policy() const { return ActorWeights<float>(actor_, action_size_); }

  template <typename Body>
  void ForEachPart(Body body) {
    body("updates", updates_);
    body("actor", actor_);
  }

 private:
  int action_size_;
  int64_t updates_ = 0;
  Network<float> actor_;
  MatrixBuffer<float> actions_, gradient_;  // pi(s), and d loss / d pi(s): action x batch
};

Result<std::unique_ptr<Learner>> Create(const LearnerContext& context) {
  ActorCriticOptions options;
  SetActorCriticOptions(context, context.observation_size(), options);
  B4MRL_RETURN_IF_ERROR(ValidateActorCritic(options));
  const bool normalise = context.hyperparameters.Chosen("normalise", "true");
  B4MRL_ASSIGN_OR_RETURN(
      OfflineBatches batches,
      OfflineBatches::Open(context, {.batch_size = options.batch_max, .normalise = normalise}));
  return MakeOfflineLearner(BcCore(options), std::move(batches));
}

}  // namespace

Algorithm BcAlgorithm() {
  return {.name = "bc",
          .description = "behaviour cloning, offline on a dataset",
          .needs = {.dataset = true},
          .hyperparameters = HyperparameterTable{NormaliseRow(kSource)} + NetworkRows(kSource),
          .create = Create,
          .check = CheckOfflineBatches};
}

}  // namespace b4mrl
