// H2O's two discriminators, which tell real transitions from simulated ones, and the ratio of the
// two dynamics that follows from them.
//
//   D_sa(s, a), D_sas(s, a, s')   networks with the logits 2 tanh(.): class 0 real, 1 simulated
//   P(. | s, a)     = softmax(D_sa)
//   P(. | s, a, s') = softmax(D_sas + D_sa)
//   L_sa  = mean over real -log P(real | s, a) + mean over simulated -log P(simulated | s, a)
//   L_sas = the same of P(. | s, a, s'); its gradient reaches both networks
// A step descends L_sa + L_sas, with noise of deviation `input_noise` on s, a and s', the same for
// both networks. By Bayes' rule (Eysenbach et al. 2021, DARC) the ratio of the dynamics is
//   p_real(s' | s, a) / p_sim(s' | s, a) = exp(g_0 - g_1),  g the logits of D_sas alone,
// so its logarithm lies in [-4, 4], and no probability is ever formed.
//
// The noise is Rng(seed, "discriminator-noise", step number), so a resumed run needs only the
// counter. Allocates nothing of its own after construction. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/network.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DiscriminatorOptions {
  int observation_size = 0;
  int action_size = 0;
  std::vector<int> hidden = {256, 256};
  int batch_max = 512;  // most rows of an update, real and simulated together; LogDynamicsRatios
                        // takes as many columns in one pass
  double learning_rate = 3e-4;
  double input_noise = 0.1;
  uint64_t seed = 0;  // of the initial weights and of the steps' noise
};

struct DiscriminatorMetrics {
  double state_action_loss = 0;  // L_sa
  double transition_loss = 0;    // L_sas
};

template <typename Scalar>
class Discriminators {
 public:
  static Result<Discriminators> Create(const DiscriminatorOptions& options);

  // One gradient step. Rewards and ends of episodes are not read. `noise`: standard normals in rows
  // for s, a and s', a column for each of the batch; drawn if empty.
  DiscriminatorMetrics Update(const HybridBatch<Scalar>& batch,
                              MatrixView<const Scalar> noise = {});

  // log_ratios[i] = log p_real / p_sim with column i of `next_observations` for s' and the batch's
  // column i mod n for s and a: a whole number of times, each of its n columns gets another s'.
  void LogDynamicsRatios(const TransitionBatch<Scalar>& batch,
                         MatrixView<const Scalar> next_observations, std::span<Scalar> log_ratios);

  const DiscriminatorOptions& options() const { return options_; }
  int64_t steps() const { return transition_.adam.steps(); }  // so far

  template <typename Body>
  void ForEachPart(Body body) {
    body("d_sa", state_action_);
    body("d_sas", transition_);
  }

 private:
  // From (s, a) or (s, a, s') to two logits.
  struct Classifier : Network<Scalar> {
    Classifier(const DiscriminatorOptions& options, int inputs, std::string_view weights);
    // Writes `logits`.
    void Classify(MatrixView<const Scalar> input);
    // One step of gradient descent, from `slopes` = d loss / d margin of each column.
    void Train(MatrixView<const Scalar> input, std::span<const Scalar> slopes);
    // How far the real class's logit is above the other's.
    Scalar margin(int column) const { return logits.view()(0, column) - logits.view()(1, column); }

    MatrixBuffer<Scalar> logits;  // 2 x batch
  };

  explicit Discriminators(const DiscriminatorOptions& options);
  MatrixView<const Scalar> DrawNoise(int n);

  DiscriminatorOptions options_;
  Classifier state_action_;             // D_sa
  Classifier transition_;               // D_sas
  MatrixBuffer<Scalar> input_, noise_;  // rows: s, a, s'; D_sa sees the first two
  AlignedVector<Scalar> state_action_slopes_, transition_slopes_;
};

extern template class Discriminators<float>;
extern template class Discriminators<double>;

}  // namespace b4mrl
