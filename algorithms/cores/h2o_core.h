// H2O: dynamics-aware hybrid offline-and-online learning, one update on given batches.
//
// Niu et al., "When to trust your simulator" (2022), in the order of the authors' code:
//   1. D_sa, D_sas: one step on a batch of their own (rl/discriminators.h)
//   2. for every simulated (s, a, s'), with the D_sas of step 1:
//        w = clamp(p_real / p_sim, ratio_min, 1)
//        u = mean over `gap_samples` of log p_sim / p_real at s' + gap_noise * N(0, 1),
//        which stands for the divergence of the two dynamics at (s, a); omega = u / sum u
//   3. SAC (rl/sac_core.h) on real and simulated rows in one batch, without entropy in the target;
//      the critics minimise the weighted error and the gap penalty of rl/h2o_losses.h. All losses
//      are taken before the first of its steps alpha, actor, critics, targets.
//
// Noise is a function of the options' seed and the number of the update. Allocates nothing of its
// own after construction. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/cores/discriminators.h"
#include "algorithms/cores/h2o_losses.h"
#include "algorithms/cores/sac_core.h"

namespace b4mrl {

// Over what the deviation of gap_noise is taken.
enum class GapNoiseStd {
  // As the authors' code has it: over an array that besides the dataset's observations holds ten
  // times as many zero rows, for simulated ones to come. About 0.3 of kData where the mean is 0.
  kPadded,
  kData,  // the dataset's observations, as the same laboratory's later code (D2C) has it
};

// How many noisy copies of s' a batch may have: all of them are in memory at once.
int MostGapSamples(int observation_size, int batch_max);

// scale * (deviation + 0.001) for each dimension, from the dataset's mean and population deviation.
std::vector<double> GapNoise(std::span<const double> mean, std::span<const double> std,
                             GapNoiseStd over, double scale);

struct H2oOptions : SacOptions {
  // SAC as the authors' code has it.
  H2oOptions() {
    policy.form = LogProbForm::kExact;
    entropy_in_target = false;
    actor_first = true;
    learn_log_std_scale = true;
    head_gain = 1e-2;
  }

  int discriminator_batch_max = 512;  // real and simulated rows together
  double discriminator_learning_rate = 3e-4;
  double discriminator_noise = 0.1;
  double ratio_min = 1e-5;
  int gap_samples = 10;
  std::vector<double> gap_noise;  // a deviation for each dimension of s': see GapNoise
  double gap_max = 10;
  double gap_weight = 0.01;  // beta
  double gap_limit = 1000;   // of the penalty before beta
};

struct H2oMetrics {
  SacMetrics sac;  // critic_loss is the weighted error alone
  HybridCriticLoss critic;
  DiscriminatorMetrics discriminators;
  double gap_penalty = 0;
  double mean_weight = 0;  // w
  double mean_gap = 0;     // u
};

// Standard normals for one update, features x columns.
template <typename Scalar>
struct H2oNoise {
  MatrixView<const Scalar> discriminators;  // s, a, s' x discriminator batch
  MatrixView<const Scalar> gap;             // s' x (simulated rows * gap_samples), by sample
  MatrixView<const Scalar> actions;         // action x batch
  MatrixView<const Scalar> next_actions;
};

template <typename Scalar>
class H2oCore {
 public:
  // kInvalidArgument also for a gap_noise of another size than s.
  static Result<H2oCore> Create(const H2oOptions& options);

  // One update of everything. `batch` has at most batch_max rows, `discriminator_batch` at most
  // discriminator_batch_max.
  H2oMetrics Update(const HybridBatch<Scalar>& batch,
                    const HybridBatch<Scalar>& discriminator_batch);
  // Does everything Update does but draw.
  H2oMetrics UpdateWithNoise(const HybridBatch<Scalar>& batch,
                             const HybridBatch<Scalar>& discriminator_batch,
                             const H2oNoise<Scalar>& noise);

  const H2oOptions& options() const { return options_; }
  int64_t updates() const { return sac_.updates(); }
  PolicyWeights Policy() const { return sac_.Policy(); }

  // All state, for checkpoints and tests: see nn/parameters.h.
  void VisitArrays(const ArrayVisitor<Scalar>& visitor);
  void VisitCounters(const CounterVisitor& visitor);
  // Gradients of the last update, under the names of the parameters; for tests.
  void VisitGradients(const ArrayVisitor<Scalar>& visitor);

 private:
  H2oCore(const H2oOptions& options, SacCore<Scalar> sac, Discriminators<Scalar> discriminators);
  // Of next_copies_, for the present batch: its standard normals, later noisy copies of s'.
  MatrixView<Scalar> NoisyCopies();
  // Step 2, from the standard normals in next_copies_.
  void WeighSimulated(const TransitionBatch<Scalar>& simulated, H2oMetrics& metrics);
  // The critics' loss of step 3.
  CriticLoss Loss(MatrixView<const Scalar> q, std::span<const Scalar> targets,
                  MatrixView<Scalar> q_gradient);
  CriticObjective<Scalar> Objective();

  H2oOptions options_;
  SacCore<Scalar> sac_;
  Discriminators<Scalar> discriminators_;

  int simulated_rows_ = 0;        // of the present batch
  HybridCriticLoss critic_loss_;  // of the present update, as is the penalty
  double gap_penalty_ = 0;
  MatrixBuffer<Scalar> next_copies_;  // s' of all simulated rows, then its noisy copies by sample
  AlignedVector<Scalar> log_ratios_;  // one a column of next_copies_
  AlignedVector<Scalar> weights_, gaps_;  // one a simulated row
  AlignedVector<double> log_gap_weights_;
};

extern template class H2oCore<float>;
extern template class H2oCore<double>;

}  // namespace b4mrl
