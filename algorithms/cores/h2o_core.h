// H2O: dynamics-aware hybrid offline-and-online learning, one update on given batches.
//
// Niu et al., "When to trust your simulator" (2022), in the order of the authors' code:
//   1. D_sa, D_sas: one step on a batch of their own (discriminators.h)
//   2. for every simulated (s, a, s'), with the D_sas of step 1:
//        w = clamp(p_real / p_sim, ratio_min, 1)
//        u = mean over `gap_samples` of log p_sim / p_real at s' + gap_noise * N(0, 1),
//        which stands for the divergence of the two dynamics at (s, a); omega = u / sum u
//      Then SAC on real and simulated rows in one batch, with a loss of the critics of its own:
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
  // As the authors' code has it: an array that besides the dataset's observations holds ten times
  // as many zero rows, for simulated ones to come. About 0.3 of kData where the mean is 0.
  kPadded,
  kData,  // the dataset's observations, as the same laboratory's later code (D2C) has it
};

// Largest gap_samples for a batch: all noisy copies of its s' are in memory at once.
int MaxGapSamples(int observation_size, int batch_max);

// scale * (std + 0.001) for each dimension of s, from the dataset's mean and population standard
// deviation.
std::vector<double> GapNoise(std::span<const double> mean, std::span<const double> std,
                             GapNoiseStd over, double scale);

struct H2oOptions : SacOptions {
  H2oOptions() { policy.form = LogProbForm::kExact; }  // as the authors' code has it

  double head_gain = 1e-2;            // output layers start as MlpLayout::InitializeHead draws them
  int discriminator_batch_max = 512;  // most rows of a discriminators' batch, both kinds together
  double discriminator_learning_rate = 3e-4;
  double discriminator_noise = 0.1;  // standard deviation of the noise on their inputs
  double ratio_min = 1e-5;
  int gap_samples = 10;           // noisy copies of an s' for one estimate of the gap
  std::vector<double> gap_noise;  // standard deviation in each dimension of s': see GapNoise
  double gap_max = 10;            // largest u, in nats
  double gap_weight = 0.01;       // beta of h2o_losses.h
  double gap_limit = 1000;        // largest magnitude of the penalty before it is weighed by beta
};

struct H2oMetrics {
  SacMetrics sac;  // critic_loss is the weighted error alone
  HybridCriticLoss critic;
  DiscriminatorMetrics discriminators;
  double gap_penalty = 0;
  double mean_weight = 0;  // w
  double mean_gap = 0;     // u
};
// Adds these numbers under the names that they have in every learner's logs.
void AddMetrics(const H2oMetrics& values, MetricMeans& metrics);

// The standard normals of an update, features x columns.
template <typename Scalar>
struct H2oNoise {
  MatrixView<const Scalar> discriminators;  // s, a, s' x discriminator batch
  MatrixView<const Scalar> gap;             // s' x (gap_samples * simulated rows), by sample
  MatrixView<const Scalar> actions;         // action x 2 batch: see SoftActor::DrawNoise
};

template <typename Scalar>
class H2oCore : public TrainedParts<H2oCore<Scalar>, Scalar> {
 public:
  // kInvalidArgument also for a gap_noise of another size than s.
  static Result<H2oCore> Create(const H2oOptions& options);

  // One gradient step of all networks. `batch` has at most batch_max rows, `discriminator_batch` at
  // most discriminator_batch_max. Each part of `noise` is drawn if empty.
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
  // Step 2.
  void WeighSimulated(const TransitionBatch<Scalar>& simulated, MatrixView<const Scalar> noise,
                      H2oMetrics& metrics);
  // Steps 4, and 6 with 7.
  void ComputeTargets(const TransitionBatch<Scalar>& batch, H2oMetrics& metrics);
  void UpdateCritics(const HybridBatch<Scalar>& batch, H2oMetrics& metrics);

  H2oOptions options_;
  int64_t updates_ = 0;
  SoftActor<Scalar> actor_;
  TwinCritics<Scalar> critics_;
  Discriminators<Scalar> discriminators_;

  // s' of the simulated rows of a batch, then gap_samples times as many columns: first their
  // standard normals, then noisy copies of s'.
  MatrixBuffer<Scalar> next_copies_;
  AlignedVector<Scalar> log_ratios_;       // one a column of next_copies_
  AlignedVector<Scalar> weights_, gaps_;   // w and u, one a simulated row
  AlignedVector<double> log_gap_weights_;  // log omega
};

extern template class H2oCore<float>;
extern template class H2oCore<double>;

}  // namespace b4mrl
