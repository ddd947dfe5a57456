// Fixed-order inference of a policy: the arithmetic behind everything that makes data or scores.
//
// The last bits of BLAS products depend on the processor and on the batch size. Here every output
// is one chain of fused multiply-adds over the inputs in index order, so an observation's action
// has equal bits in a batch of any size, on any x86-64 processor with AVX2 and FMA. tanh and exp
// are our own (errors below 4e-7 absolute and 4e-7 relative). The kernels are compiled for
// x86-64-v3 and use neither Eigen nor BLAS nor libm. Thread rule: only Assign changes a
// FixedOrderPolicy, and calls share no scratch space, so any number of threads may share a policy
// while none calls Assign.
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

// A network with a mean head and, for stochastic policies, a log_std head. The action is
// tanh(mean) or tanh(mean + exp(clamp(log_std)) e), e standard normal.
struct PolicyWeights {
  int observation_size = 0;
  int action_size = 0;
  std::vector<DenseWeights> hidden;
  bool hidden_tanh = false;  // each hidden layer is followed by tanh; false: by ReLU
  DenseWeights mean;
  std::optional<DenseWeights> log_std;
  float log_std_min = -20;
  float log_std_max = 2;
  // The network's input is mask * (observation - mean) / std. Each of these vectors is empty or has
  // observation_size numbers.
  std::vector<float> observation_mean;
  std::vector<float> observation_std;
  std::vector<float> observation_mask;  // 1 seen, 0 hidden
};

// All weights as one vector, for checkpoints: hidden layers, mean and log_std head, of each layer
// the weight and then the bias. Observation mean, std and mask are left out.
std::vector<float> FlattenPolicy(const PolicyWeights& policy);
// Writes the weights `numbers` into `policy`, which has the shape of the flattened policy. Returns
// false and changes nothing if the number of weights differs.
bool UnflattenPolicy(std::span<const float> numbers, PolicyWeights& policy);

class FixedOrderPolicy {
 public:
  // kInvalidArgument for inconsistent shapes or numbers that are not finite; kUnsupported on a
  // processor without AVX2 and FMA.
  static Result<FixedOrderPolicy> Create(const PolicyWeights& weights);
  // Replaces the policy by that of `weights`, with Create's errors, which leave it as it was. Keeps
  // the memory where shapes are equal: a learner acts by other weights after every update.
  Status Assign(const PolicyWeights& weights);
  FixedOrderPolicy(FixedOrderPolicy&&) noexcept;
  FixedOrderPolicy& operator=(FixedOrderPolicy&&) noexcept;
  ~FixedOrderPolicy();

  int observation_size() const;
  int action_size() const;
  bool stochastic() const;  // whether the policy has a log_std head

  // actions (action x n) = tanh(mean) for observations (observation x n).
  void Act(MatrixView<const float> observations, MatrixView<float> actions) const;
  // Computes stochastic actions from standard normals `noise` (action x n). Needs stochastic().
  // `log_probs` (n, or empty) receives sum_i [-e^2/2 - log_std - log(2 pi)/2 - log(1 - a^2 +
  // 1e-6)], also in fixed order; dataset files store these log densities.
  void Sample(MatrixView<const float> observations, MatrixView<const float> noise,
              MatrixView<float> actions, std::span<float> log_probs = {}) const;

 private:
  struct Network;
  FixedOrderPolicy();
  std::unique_ptr<Network> network_;
};

}  // namespace b4mrl
