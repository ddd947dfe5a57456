// H2O's two discriminators, which tell real transitions from simulated ones, and the ratio of the
// two dynamics that follows from them.
//
//   D_sa(s, a), D_sas(s, a, s')   networks with the logits 2 tanh(.): class 0 real, 1 simulated
//   P(. | s, a)     = softmax(D_sa)
//   P(. | s, a, s') = softmax(D_sas + D_sa)
//   L_sa  = mean over real -log P(real | s, a) + mean over simulated -log P(simulated | s, a)
//   L_sas = L_sa with P(. | s, a, s') for P(. | s, a); its gradient reaches both networks
// A step descends L_sa + L_sas, with normal noise of standard deviation `input_noise` on s, a and
// s', equal for both networks. By Bayes' rule (Eysenbach et al. 2021, DARC) the dynamics ratio is
//   p_real(s' | s, a) / p_sim(s' | s, a) = exp(g_0 - g_1),  g the logits of D_sas alone,
// so its logarithm lies in [-4, 4], and no probability is ever formed.
//
// The noise is Rng(seed, "discriminator-noise", step number), so a resumed run needs only the step
// number. Allocates nothing of its own after construction. Thread rule: one thread.
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
  int batch_max = 512;  // most rows of an update, both kinds together, and most columns that
                        // LogDynamicsRatios evaluates in one pass
  double learning_rate = 3e-4;
  double input_noise = 0.1;                // standard deviation
  uint64_t seed = 0;                       // of the initial weights and of the steps' noise
  Precision precision = Precision::kFp32;  // of products between two hidden layers
};

struct DiscriminatorMetrics {
  double state_action_loss = 0;  // L_sa
  double transition_loss = 0;    // L_sas
};

template <typename Scalar>
class Discriminators {
 public:
  static Result<Discriminators> Create(const DiscriminatorOptions& options);

  // One gradient step. Rewards and not_terminated are not read. `noise`: standard normals, with
  // rows for s, a and s' and as many columns as the batch; drawn if empty.
  DiscriminatorMetrics Update(const HybridBatch<Scalar>& batch,
                              MatrixView<const Scalar> noise = {});

  // log_ratios[i] = log p_real / p_sim at s, a of the batch's column i mod n and s' in column i of
  // `next_observations`, which has a multiple of the batch's n columns.
  void LogDynamicsRatios(const TransitionBatch<Scalar>& batch,
                         MatrixView<const Scalar> next_observations, std::span<Scalar> log_ratios);

  const DiscriminatorOptions& options() const { return options_; }
  int64_t steps() const { return transition_.adam.steps(); }  // gradient steps so far

  template <typename Body>
  void ForEachPart(Body body) {
    body("d_sa", state_action_);
    body("d_sas", transition_);
  }

 private:
  // A network from (s, a) or (s, a, s') to two logits, for real and simulated.
  struct Classifier : Network<Scalar> {
    Classifier(const DiscriminatorOptions& options, int inputs, std::string_view weights);
    // Writes the logits of all columns of `input` to `logits`.
    void Classify(MatrixView<const Scalar> input);
    // One step of gradient descent, from `slopes` = d loss / d margin of each column.
    void Train(MatrixView<const Scalar> input, std::span<const Scalar> slopes);
    // The logit of class real minus the logit of class simulated.
    Scalar margin(int column) const { return logits.view()(0, column) - logits.view()(1, column); }

    MatrixBuffer<Scalar> logits;  // 2 x batch
  };

  explicit Discriminators(const DiscriminatorOptions& options);
  MatrixView<const Scalar> DrawNoise(int n);

  DiscriminatorOptions options_;
  Classifier state_action_;             // D_sa
  Classifier transition_;               // D_sas
  MatrixBuffer<Scalar> input_, noise_;  // rows: s, a, s'; D_sa reads the rows of s and a
  AlignedVector<Scalar> state_action_slopes_, transition_slopes_;
};

extern template class Discriminators<float>;
extern template class Discriminators<double>;

}  // namespace b4mrl
