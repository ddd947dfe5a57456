#include "algorithms/policy/inference.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "algorithms/policy/inference_kernels.h"

namespace b4mrl {
namespace {

using inference::kPanel;
using inference::Padded;

constexpr int kWidthMax = 1 << 14;
constexpr int kRowsPerBlock = 48;  // a multiple of the kernel's six rows; activations stay in L2

struct PackedLayer {
  int inputs = 0;
  int outputs = 0;
  AlignedVector<float> weights;
  AlignedVector<float> bias;
};

// Packs a layer's weights into memory that `packed` may have from an earlier call.
void Pack(const DenseWeights& dense, PackedLayer& packed) {
  packed.inputs = dense.inputs;
  packed.outputs = dense.outputs;
  const int padded = Padded(dense.outputs);
  packed.weights.resize(static_cast<size_t>(padded) * dense.inputs);
  packed.bias.assign(padded, 0.0f);
  std::copy(dense.bias.begin(), dense.bias.end(), packed.bias.begin());
  float* to = packed.weights.data();
  for (int first = 0; first < dense.outputs; first += kPanel) {
    const int outputs = std::min(kPanel, dense.outputs - first);
    const float* from = dense.weight.data() + static_cast<size_t>(first) * dense.inputs;
    for (int k = 0; k < dense.inputs; ++k, to += kPanel) {
      for (int o = 0; o < outputs; ++o) to[o] = from[static_cast<size_t>(o) * dense.inputs + k];
      std::fill(to + outputs, to + kPanel, 0.0f);
    }
  }
}

bool AllFinite(const std::vector<float>& values) {
  return inference::AllFinite(values.data(), values.size());
}

Status ValidateLayer(const std::string& name, const DenseWeights& dense, int inputs) {
  if (dense.inputs != inputs) {
    return InvalidArgument(name + ".inputs", std::to_string(dense.inputs), std::to_string(inputs));
  }
  if (dense.outputs < 1 || dense.outputs > kWidthMax) {
    return InvalidArgument(name + ".outputs", std::to_string(dense.outputs),
                           "1.." + std::to_string(kWidthMax));
  }
  const size_t size = static_cast<size_t>(dense.inputs) * dense.outputs;
  if (dense.weight.size() != size) {
    return InvalidArgument("length of " + name + ".weight", std::to_string(dense.weight.size()),
                           std::to_string(size));
  }
  if (dense.bias.size() != static_cast<size_t>(dense.outputs)) {
    return InvalidArgument("length of " + name + ".bias", std::to_string(dense.bias.size()),
                           std::to_string(dense.outputs));
  }
  if (!AllFinite(dense.weight) || !AllFinite(dense.bias)) {
    return InvalidArgument(name, "NaN or infinity", "finite numbers");
  }
  return {};
}

Status ValidateFeatures(const std::string& name, const std::vector<float>& values, int size) {
  if (!values.empty() && values.size() != static_cast<size_t>(size)) {
    return InvalidArgument("length of " + name, std::to_string(values.size()),
                           "0 or " + std::to_string(size));
  }
  if (!AllFinite(values)) return InvalidArgument(name, "NaN or infinity", "finite numbers");
  return {};
}

Status ValidateInput(const PolicyWeights& weights) {
  const int size = weights.observation_size;
  if (size < 1 || size > kWidthMax) {
    return InvalidArgument("observation_size", std::to_string(size),
                           "1.." + std::to_string(kWidthMax));
  }
  B4MRL_RETURN_IF_ERROR(ValidateFeatures("observation_mean", weights.observation_mean, size));
  B4MRL_RETURN_IF_ERROR(ValidateFeatures("observation_std", weights.observation_std, size));
  B4MRL_RETURN_IF_ERROR(ValidateFeatures("observation_mask", weights.observation_mask, size));
  for (const float std : weights.observation_std) {
    if (!(std > 0)) return InvalidNumber("observation_std", std, "numbers above 0");
  }
  for (const float seen : weights.observation_mask) {
    if (seen != 0 && seen != 1) return InvalidNumber("observation_mask", seen, "0 or 1");
  }
  return {};
}

Status ValidateHeads(const PolicyWeights& weights, int inputs) {
  B4MRL_RETURN_IF_ERROR(ValidateLayer("mean", weights.mean, inputs));
  if (weights.mean.outputs != weights.action_size) {
    return InvalidArgument("mean.outputs", std::to_string(weights.mean.outputs),
                           std::to_string(weights.action_size));
  }
  if (!weights.log_std) return {};
  B4MRL_RETURN_IF_ERROR(ValidateLayer("log_std", *weights.log_std, inputs));
  if (weights.log_std->outputs != weights.action_size) {
    return InvalidArgument("log_std.outputs", std::to_string(weights.log_std->outputs),
                           std::to_string(weights.action_size));
  }
  if (!(weights.log_std_min <= weights.log_std_max)) {
    return InvalidNumber("log_std_min", weights.log_std_min, "at most log_std_max");
  }
  return {};
}

Status Validate(const PolicyWeights& weights) {
  B4MRL_RETURN_IF_ERROR(ValidateInput(weights));
  int inputs = weights.observation_size;
  for (size_t i = 0; i < weights.hidden.size(); ++i) {
    B4MRL_RETURN_IF_ERROR(
        ValidateLayer("hidden[" + std::to_string(i) + "]", weights.hidden[i], inputs));
    inputs = weights.hidden[i].outputs;
  }
  return ValidateHeads(weights, inputs);
}

// Calls the visitor with every vector of weights of `policy`, in the order of FlattenPolicy.
template <typename Policy, typename Visitor>
void VisitVectors(Policy& policy, const Visitor& visit) {
  for (auto& layer : policy.hidden) {
    visit(layer.weight);
    visit(layer.bias);
  }
  visit(policy.mean.weight);
  visit(policy.mean.bias);
  if (policy.log_std) {
    visit(policy.log_std->weight);
    visit(policy.log_std->bias);
  }
}

void RunLayer(const PackedLayer& layer, bool relu, const float* input, int stride, int rows,
              float* output) {
  inference::Dense(layer.weights.data(), layer.bias.data(), layer.inputs, layer.outputs, relu,
                   input, stride, rows, output, stride);
}

}  // namespace

std::vector<float> FlattenPolicy(const PolicyWeights& policy) {
  std::vector<float> numbers;
  VisitVectors(policy, [&](const std::vector<float>& values) {
    numbers.insert(numbers.end(), values.begin(), values.end());
  });
  return numbers;
}

bool UnflattenPolicy(std::span<const float> numbers, PolicyWeights& policy) {
  size_t size = 0;
  VisitVectors(policy, [&](const std::vector<float>& values) { size += values.size(); });
  if (size != numbers.size()) return false;
  VisitVectors(policy, [&](std::vector<float>& values) {
    std::copy_n(numbers.begin(), values.size(), values.begin());
    numbers = numbers.subspan(values.size());
  });
  return true;
}

struct FixedOrderPolicy::Network {
  int observation_size = 0;
  int action_size = 0;
  int stride = 0;  // of scratch rows, in numbers: the width of the widest layer, padded
  bool hidden_tanh = false;
  std::vector<PackedLayer> hidden;
  PackedLayer mean;
  std::optional<PackedLayer> log_std;
  float log_std_min = 0;
  float log_std_max = 0;
  std::vector<float> shift;  // observation mean
  std::vector<float> scale;  // 1 / observation std
  std::vector<char> seen;

  void Assign(const PolicyWeights& weights) {
    observation_size = weights.observation_size;
    action_size = weights.action_size;
    hidden_tanh = weights.hidden_tanh;
    int widest = std::max(weights.observation_size, weights.action_size);
    hidden.resize(weights.hidden.size());
    for (size_t i = 0; i < hidden.size(); ++i) {
      Pack(weights.hidden[i], hidden[i]);
      widest = std::max(widest, weights.hidden[i].outputs);
    }
    stride = Padded(widest);
    Pack(weights.mean, mean);
    if (!weights.log_std) log_std.reset();
    if (weights.log_std) Pack(*weights.log_std, log_std ? *log_std : log_std.emplace());
    log_std_min = weights.log_std_min;
    log_std_max = weights.log_std_max;
    AssignInput(weights);
  }

  void AssignInput(const PolicyWeights& weights) {
    shift.assign(observation_size, 0.0f);
    scale.assign(observation_size, 1.0f);
    seen.assign(observation_size, 1);
    std::copy(weights.observation_mean.begin(), weights.observation_mean.end(), shift.begin());
    std::transform(weights.observation_std.begin(), weights.observation_std.end(), scale.begin(),
                   [](float value) { return 1.0f / value; });
    std::transform(weights.observation_mask.begin(), weights.observation_mask.end(), seen.begin(),
                   [](float value) { return value != 0; });
  }

  void LoadInput(MatrixView<const float> observations, float* rows) const {
    for (int column = 0; column < observations.columns; ++column) {
      const float* from = observations.column(column);
      float* to = rows + static_cast<std::ptrdiff_t>(column) * stride;
      for (int k = 0; k < observation_size; ++k) {
        // No product with the mask, so that a hidden dimension becomes 0 even if it is NaN.
        to[k] = seen[k] ? (from[k] - shift[k]) * scale[k] : 0.0f;
      }
    }
  }

  // Computes actions from the mean head's outputs, which are rows of `stride` numbers.
  void Squash(float* means, MatrixView<float> actions) const {
    for (int row = 0; row < actions.columns; ++row) {
      float* action = means + static_cast<std::ptrdiff_t>(row) * stride;
      inference::TanhInPlace(action_size, action);
      std::memcpy(actions.column(row), action, sizeof(float) * action_size);
    }
  }

  // Computes stochastic actions and, unless `log_probs` is null, their log densities from the
  // heads' outputs. `spare` has room for two rows.
  void SquashSample(float* means, const float* log_stds, MatrixView<const float> noise,
                    MatrixView<float> actions, float* log_probs, float* spare) const {
    float* const padded_noise = spare;
    float* const terms = spare + stride;
    std::fill_n(padded_noise, stride, 0.0f);
    for (int row = 0; row < actions.columns; ++row) {
      float* action = means + static_cast<std::ptrdiff_t>(row) * stride;
      std::memcpy(padded_noise, noise.column(row), sizeof(float) * action_size);
      inference::SquashSample(action_size, log_std_min, log_std_max,
                              log_stds + static_cast<std::ptrdiff_t>(row) * stride, padded_noise,
                              action, terms);
      std::memcpy(actions.column(row), action, sizeof(float) * action_size);
      if (log_probs == nullptr) continue;
      float sum = 0;
      for (int k = 0; k < action_size; ++k) sum += terms[k];
      log_probs[row] = sum;
    }
  }

  // Computes the actions of at most kRowsPerBlock columns; deterministic actions if `noise.data` is
  // null. `scratch` has room for three rows per observation and two more rows.
  void RunBlock(MatrixView<const float> observations, MatrixView<const float> noise,
                MatrixView<float> actions, float* log_probs, float* scratch) const {
    const int rows = observations.columns;
    const std::ptrdiff_t block = static_cast<std::ptrdiff_t>(rows) * stride;
    float* input = scratch;
    float* output = scratch + block;
    float* const log_stds = scratch + 2 * block;
    LoadInput(observations, input);
    for (const PackedLayer& layer : hidden) {
      RunLayer(layer, /*relu=*/!hidden_tanh, input, stride, rows, output);
      if (hidden_tanh) {
        for (int row = 0; row < rows; ++row) {
          inference::TanhInPlace(layer.outputs, output + static_cast<std::ptrdiff_t>(row) * stride);
        }
      }
      std::swap(input, output);
    }
    RunLayer(mean, /*relu=*/false, input, stride, rows, output);
    if (noise.data == nullptr) {
      Squash(output, actions);
      return;
    }
    RunLayer(*log_std, /*relu=*/false, input, stride, rows, log_stds);
    SquashSample(output, log_stds, noise, actions, log_probs, scratch + 3 * block);
  }

  void Run(MatrixView<const float> observations, MatrixView<const float> noise,
           MatrixView<float> actions, std::span<float> log_probs) const {
    const int block = std::min(kRowsPerBlock, observations.columns);
    const size_t scratch_size = (static_cast<size_t>(3) * block + 2) * stride;
    const std::unique_ptr<float[]> scratch = std::make_unique_for_overwrite<float[]>(scratch_size);
    for (int first = 0; first < observations.columns; first += block) {
      const int count = std::min(block, observations.columns - first);
      RunBlock(observations.ColumnBlock(first, count),
               noise.data == nullptr ? noise : noise.ColumnBlock(first, count),
               actions.ColumnBlock(first, count),
               log_probs.empty() ? nullptr : log_probs.data() + first, scratch.get());
    }
  }
};

FixedOrderPolicy::FixedOrderPolicy() : network_(std::make_unique<Network>()) {}
FixedOrderPolicy::FixedOrderPolicy(FixedOrderPolicy&&) noexcept = default;
FixedOrderPolicy& FixedOrderPolicy::operator=(FixedOrderPolicy&&) noexcept = default;
FixedOrderPolicy::~FixedOrderPolicy() = default;

Result<FixedOrderPolicy> FixedOrderPolicy::Create(const PolicyWeights& weights) {
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) {
    return Status(StatusCode::kUnsupported,
                  "this processor has no AVX2 or no FMA; policies need both");
  }
  FixedOrderPolicy policy;
  B4MRL_RETURN_IF_ERROR(policy.Assign(weights));
  return policy;
}

Status FixedOrderPolicy::Assign(const PolicyWeights& weights) {
  B4MRL_RETURN_IF_ERROR(Validate(weights));
  network_->Assign(weights);
  return {};
}

int FixedOrderPolicy::observation_size() const { return network_->observation_size; }
int FixedOrderPolicy::action_size() const { return network_->action_size; }
bool FixedOrderPolicy::stochastic() const { return network_->log_std.has_value(); }

void FixedOrderPolicy::Act(MatrixView<const float> observations, MatrixView<float> actions) const {
  network_->Run(observations, {}, actions, {});
}

void FixedOrderPolicy::Sample(MatrixView<const float> observations, MatrixView<const float> noise,
                              MatrixView<float> actions, std::span<float> log_probs) const {
  network_->Run(observations, noise, actions, log_probs);
}

}  // namespace b4mrl
