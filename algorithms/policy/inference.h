// Fixed-order inference of a policy: the arithmetic behind everything that makes data or scores.
//
// BLAS gives other last bits on other processors and for other batch sizes. Here every output is
// one chain of fused multiply-adds over the inputs in index order, whatever the batch, so a row's
// action has equal bits on any x86-64 processor with AVX2 and FMA, alone or among thousands. tanh
// and exp are our own (errors below 4e-7 absolute and 4e-7 relative). The kernels are compiled for
// x86-64-v3 and use neither Eigen nor BLAS nor libm. Thread rule: FixedOrderPolicy is immutable
// after Create and holds no scratch space shared between calls; any number of threads may use one.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "algorithms/nn/products/view.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DenseWeights {
  int inputs = 0;
  int outputs = 0;
  std::vector<float> weight;  // (outputs, inputs) row-major
  std::vector<float> bias;    // outputs
};

// A ReLU network with a mean head and, for stochastic policies, a log_std head. The action is
// tanh(mean) or tanh(mean + exp(clamp(log_std)) e), e standard normal.
struct PolicyWeights {
  int observation_size = 0;
  int action_size = 0;
  std::vector<DenseWeights> hidden;
  DenseWeights mean;
  std::optional<DenseWeights> log_std;
  float log_std_min = -20;
  float log_std_max = 2;
  // The network's input is mask * (observation - mean) / std; each empty or observation_size long.
  std::vector<float> observation_mean;
  std::vector<float> observation_std;
  std::vector<float> observation_mask;  // 1 seen, 0 hidden
};

// All weights as one run of numbers, for checkpoints: hidden layers, mean, log_std, each weight
// then bias. Normaliser and mask are not included.
std::vector<float> FlattenPolicy(const PolicyWeights& policy);
// Into a policy of the same shape; false, changing nothing, when the length does not fit.
bool UnflattenPolicy(std::span<const float> numbers, PolicyWeights& policy);

class FixedOrderPolicy {
 public:
  // kInvalidArgument for inconsistent shapes or numbers that are not finite; kUnsupported on a
  // processor without AVX2 and FMA.
  static Result<FixedOrderPolicy> Create(const PolicyWeights& weights);
  FixedOrderPolicy(FixedOrderPolicy&&) noexcept;
  FixedOrderPolicy& operator=(FixedOrderPolicy&&) noexcept;
  ~FixedOrderPolicy();

  int observation_size() const;
  int action_size() const;
  bool stochastic() const;  // has a log_std head

  // actions (action x n) = tanh(mean) for observations (observation x n).
  void Act(MatrixView<const float> observations, MatrixView<float> actions) const;
  // The stochastic action for the standard normals `noise` (action x n). Needs stochastic().
  // `log_probs` (n, or empty): sum_i [-e^2/2 - log_std - log(2 pi)/2 - log(1 - a^2 + 1e-6)], in
  // fixed order too; dataset files store it.
  void Sample(MatrixView<const float> observations, MatrixView<const float> noise,
              MatrixView<float> actions, std::span<float> log_probs = {}) const;

 private:
  struct Network;
  explicit FixedOrderPolicy(std::unique_ptr<const Network> network);
  std::unique_ptr<const Network> network_;
};

}  // namespace b4mrl
