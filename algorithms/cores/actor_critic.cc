#include "algorithms/cores/actor_critic.h"

#include <cmath>
#include <string>

#include "algorithms/nn/products/eigen_map.h"
#include "algorithms/nn/squashed_gaussian.h"

namespace b4mrl {
namespace {

constexpr int kWidthMax = 1 << 16;
constexpr int kLayersMax = 16;
constexpr int kBatchMax = 1 << 20;
constexpr int kThreadsMax = 64;

Status ValidateRange(std::string_view name, int value, int high) {
  if (value >= 1 && value <= high) return {};
  return InvalidArgument(name, std::to_string(value), "1.." + std::to_string(high));
}

// The weights of outputs [first, first + count) of a layer with one member.
template <typename Scalar>
DenseWeights LayerRows(const MlpLayout::Layer& layer, std::span<const Scalar> parameters, int first,
                       int count) {
  const Scalar* weight =
      parameters.data() + layer.weight + static_cast<int64_t>(first) * layer.inputs;
  const Scalar* bias = parameters.data() + layer.bias + first;
  DenseWeights dense;
  dense.inputs = layer.inputs;
  dense.outputs = count;
  dense.weight.assign(weight, weight + static_cast<int64_t>(count) * layer.inputs);
  dense.bias.assign(bias, bias + count);
  return dense;
}

}  // namespace

Status ValidateSizes(int observation_size, int action_size, const std::vector<int>& hidden,
                     int batch_max) {
  B4MRL_RETURN_IF_ERROR(ValidateRange("observation_size", observation_size, kWidthMax));
  B4MRL_RETURN_IF_ERROR(ValidateRange("action_size", action_size, kActionMax));
  B4MRL_RETURN_IF_ERROR(ValidateRange("batch_max", batch_max, kBatchMax));
  B4MRL_RETURN_IF_ERROR(
      ValidateRange("number of hidden layers", static_cast<int>(hidden.size()), kLayersMax));
  for (const int width : hidden) {
    B4MRL_RETURN_IF_ERROR(ValidateRange("hidden layer width", width, kWidthMax));
  }
  return {};
}

Status ValidateActorCritic(const ActorCriticOptions& options) {
  B4MRL_RETURN_IF_ERROR(ValidateSizes(options.observation_size, options.action_size, options.hidden,
                                      options.batch_max));
  B4MRL_RETURN_IF_ERROR(ValidateRange("threads", options.threads, kThreadsMax));
  B4MRL_RETURN_IF_ERROR(CheckPrecision(options.precision));
  B4MRL_RETURN_IF_ERROR(ValidateRate("actor_learning_rate", options.actor_learning_rate));
  B4MRL_RETURN_IF_ERROR(ValidateRate("critic_learning_rate", options.critic_learning_rate));
  B4MRL_RETURN_IF_ERROR(ValidateUnitInterval("gamma", options.gamma));
  return ValidateUnitInterval("tau", options.tau);
}

Status ValidateRate(std::string_view name, double value) {
  if (std::isfinite(value) && value >= 0) return {};
  return InvalidNumber(name, value, "a finite number of at least 0");
}

Status ValidateUnitInterval(std::string_view name, double value) {
  if (value >= 0 && value <= 1) return {};
  return InvalidNumber(name, value, "0..1");
}

MlpShape ActorShape(const ActorCriticOptions& options, int outputs) {
  return {.inputs = options.observation_size, .hidden = options.hidden, .outputs = outputs};
}

template <typename Scalar>
TwinCritics<Scalar>::TwinCritics(const ActorCriticOptions& options, const InitialWeights& weights)
    : Network<Scalar>({.shape = {.members = 2,
                                 .inputs = options.observation_size + options.action_size,
                                 .hidden = options.hidden,
                                 .outputs = 1},
                       .learning_rate = options.critic_learning_rate,
                       .batch_max = options.batch_max,
                       .threads = options.threads,
                       .precision = options.precision,
                       .has_target = true,
                       .weights = weights}),
      input(options.observation_size + options.action_size, options.batch_max),
      targets(options.batch_max) {}

template <typename Scalar>
MatrixView<const Scalar> TwinCritics<Scalar>::Stack(MatrixView<const Scalar> observations,
                                                    MatrixView<const Scalar> actions) {
  const MatrixView<Scalar> stacked = input.view(observations.columns);
  StackRows<Scalar>({observations, actions}, stacked);
  return stacked;
}

template <typename Scalar>
PolicyWeights ActorWeights(const Network<Scalar>& actor, int action_size) {
  PolicyWeights weights;
  weights.observation_size = actor.layout.shape().inputs;
  weights.action_size = action_size;
  const size_t last = actor.layout.layers().size() - 1;
  for (size_t i = 0; i < last; ++i) {
    const MlpLayout::Layer& layer = actor.layout.layers()[i];
    weights.hidden.push_back(LayerRows<Scalar>(layer, actor.values, 0, layer.outputs));
  }
  const MlpLayout::Layer& head = actor.layout.layers()[last];
  weights.mean = LayerRows<Scalar>(head, actor.values, 0, action_size);
  if (head.outputs == 2 * action_size) {
    weights.log_std = LayerRows<Scalar>(head, actor.values, action_size, action_size);
  }
  return weights;
}

template struct TwinCritics<float>;
template struct TwinCritics<double>;
template PolicyWeights ActorWeights<float>(const Network<float>&, int);
template PolicyWeights ActorWeights<double>(const Network<double>&, int);

}  // namespace b4mrl
