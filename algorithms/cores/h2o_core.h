// H2O: dynamics-aware hybrid offline-and-online learning, one update on given batches.
//
// Niu et al., "When to trust your simulator" (2022), in the order of the authors' code:
//   1. discriminators D_sa, D_sas: one step on `discriminator_batch` (discriminators.h)
//   2. for every simulated (s, a, s'), with the D_sas of step 1:
//        w = clamp(p_real / p_sim, ratio_min, 1)
//        u = mean over `gap_samples` of log p_sim / p_real at s' + gap_noise * N(0, 1),
//        which stands for the divergence of the two dynamics at (s, a); omega = u / sum u
//      Then SAC on real and simulated rows in one batch, with H2O's own loss of the critics:
//   3. a, log pi(a|s) from the actor, and one step of alpha, as in SAC (soft_actor.h)
//   4. y = r + not_terminated gamma min Q'(s', a'): without entropy
//   5. actor, as in SAC but before the critics' step
//   6. critics: L = the error to y, weighted by w, plus the gap penalty with omega (h2o_losses.h)
//   7. Q' <- tau Q + (1 - tau) Q'
//
// Allocates nothing of its own after construction. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/cores/discriminators.h"
#include "algorithms/cores/h2o_losses.h"
#include "algorithms/cores/soft_actor.h"

namespace b4mrl {

class MetricMeans;

// The rows whose standard deviation is the unit of gap_noise.
enum class GapNoiseStd {
  // The rows of the authors' replay array: the dataset's observations and ten times as many zero
  // rows, reserved for simulated data. Gives 0.3 of kData's deviation where the mean is 0, and more
  // than that deviation where the mean is beyond 3.3 deviations.
  kPadded,
  kData,  // the dataset's observations, as the same laboratory's later code (D2C) has it
};

// Largest gap_samples for batches of batch_max rows: all noisy copies of s' are in memory at once.
int MaxGapSamples(int observation_size, int batch_max);

// H2oOptions::gap_noise: scale * (std + 0.001) for each dimension of s, with the dataset's mean and
// population standard deviation.
std::vector<double> GapNoise(std::span<const double> mean, std::span<const double> std,
                             GapNoiseStd over, double scale);

struct H2oOptions : SacOptions {
  H2oOptions() { policy.form = LogProbForm::kExact; }  // as the authors' code has it

  double head_gain = 1e-2;            // output layers start as MlpLayout::InitializeHead draws them
  int discriminator_batch_max = 512;  // most rows of a discriminator_batch, both kinds together
  double discriminator_learning_rate = 3e-4;
  double discriminator_noise = 0.1;  // standard deviation of the noise on discriminators' inputs
  double ratio_min = 1e-5;           // smallest weight w of a simulated row
  int gap_samples = 10;              // noisy copies of s' for each estimate of the gap u
  std::vector<double> gap_noise;     // standard deviation in each dimension of s': see GapNoise
  double gap_max = 10;               // largest gap u, in nats
  double gap_weight = 0.01;          // beta of h2o_losses.h
  double gap_limit = 1000;           // largest magnitude of the gap penalty before the factor beta
};

struct H2oMetrics {
  SacMetrics sac;  // sac.critic_loss excludes the gap penalty
  HybridCriticLoss critic;
  DiscriminatorMetrics discriminators;
  double gap_penalty = 0;
  double mean_weight = 0;  // mean of w over the simulated rows
  double mean_gap = 0;     // mean of u over the simulated rows, in nats
};
// Adds H2O's metrics under the names that every learner's logs use for them.
void AddMetrics(const H2oMetrics& values, MetricMeans& metrics);

// The standard normals of one update, as matrices of features x columns.
template <typename Scalar>
struct H2oNoise {
  MatrixView<const Scalar> discriminators;  // s, a, s' x discriminator batch
  MatrixView<const Scalar> gap;             // s' x (gap_samples * simulated rows), sample by sample
  MatrixView<const Scalar> actions;         // action x 2 batch: see SoftActor::DrawNoise
};

template <typename Scalar>
class H2oCore : public TrainedParts<H2oCore<Scalar>, Scalar> {
 public:
  // kInvalidArgument for invalid options, among them a gap_noise that is not as long as s.
  static Result<H2oCore> Create(const H2oOptions& options);

  // One gradient step of all networks. `batch` has at most batch_max rows, `discriminator_batch` at
  // most discriminator_batch_max rows. Empty members of `noise` are drawn.
  H2oMetrics Update(const HybridBatch<Scalar>& batch,
                    const HybridBatch<Scalar>& discriminator_batch,
                    const H2oNoise<Scalar>& noise = {});

  const H2oOptions& options() const { return options_; }
  int64_t updates() const { return updates_; }
  PolicyWeights Policy() const { return actor_.Policy(); }

  template <typename Body>
  void ForEachPart(Body body) {
    body("updates", updates_);
    actor_.ForEachPart(body);
    body("critic", critics_);
    discriminators_.ForEachPart(body);
  }

 private:
  H2oCore(const H2oOptions& options, Discriminators<Scalar> discriminators);

  MatrixView<const Scalar> DrawGapNoise(int simulated_rows);
  // Step 2 of the header comment: w and u of the simulated rows.
  void WeighSimulated(const TransitionBatch<Scalar>& simulated, MatrixView<const Scalar> noise,
                      H2oMetrics& metrics);
  // Step 4 of the header comment: the targets y. UpdateCritics does its steps 6 and 7.
  void ComputeTargets(const TransitionBatch<Scalar>& batch, H2oMetrics& metrics);
  void UpdateCritics(const HybridBatch<Scalar>& batch, H2oMetrics& metrics);

  H2oOptions options_;
  int64_t updates_ = 0;
  SoftActor<Scalar> actor_;
  TwinCritics<Scalar> critics_;
  Discriminators<Scalar> discriminators_;

  // s' of the simulated rows of a batch, then gap_samples times as many columns, which first hold
  // standard normals and then noisy copies of s'.
  MatrixBuffer<Scalar> next_copies_;
  AlignedVector<Scalar> log_ratios_;       // log p_real / p_sim of each column of next_copies_
  AlignedVector<Scalar> weights_, gaps_;   // w and u of each simulated row
  AlignedVector<double> log_gap_weights_;  // log omega
};

extern template class H2oCore<float>;
extern template class H2oCore<double>;

}  // namespace b4mrl
