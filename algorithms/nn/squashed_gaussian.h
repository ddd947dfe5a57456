// Policies whose actions are tanh(u): deterministic, or a squashed Gaussian with log-density,
//
//   log_std = clamp(raw, min, max);  u = mean + exp(log_std) e;  a = tanh(u)
//   log pi = sum_i [-e^2/2 - log_std - log(2 pi)/2 - log(1 - a^2)]
// with given standard normals e (the reparameterisation trick). Gradients with e fixed, for a loss
// with derivatives g_a by a component of an action and g_l by an action's log pi:
//   d/du = g_a (1 - a^2) + g_l * 2 a (1 - a^2) / (1 - a^2 + epsilon)
//   d mean = d/du;   d raw = d/du * exp(log_std) e - g_l, or 0 where raw was clamped.
// LogProbForm::kEpsilon computes log(1 - a^2) as log(1 - a^2 + epsilon), like Stable-Baselines3;
// kExact as the stable 2 (log 2 - u - softplus(-2u)), whose derivative has no epsilon. `head` is
// the actor's output, mean rows first, then raw log_std rows; at most kActionMax action dimensions.
// Thread rule: pure functions.
#pragma once

#include <span>

#include "algorithms/nn/products/view.h"

namespace b4mrl {

inline constexpr int kActionMax = 512;

enum class LogProbForm { kEpsilon, kExact };

struct SquashedGaussianOptions {
  LogProbForm form = LogProbForm::kEpsilon;
  double epsilon = 1e-6;  // of LogProbForm::kEpsilon
  double log_std_min = -20;
  double log_std_max = 2;
};

// head: 2 action x n; noise: action x n; writes actions (action x n, overlapping neither) and
// log_probs (n).
template <typename Scalar>
void SampleSquashedGaussian(const SquashedGaussianOptions& options, MatrixView<const Scalar> head,
                            MatrixView<const Scalar> noise, MatrixView<Scalar> actions,
                            std::span<Scalar> log_probs);

// action_gradient: d loss / d actions (action x n); log_prob_gradient: d loss / d log pi, the same
// for every row. Writes head_gradient (2 action x n).
template <typename Scalar>
void SquashedGaussianBackward(const SquashedGaussianOptions& options, MatrixView<const Scalar> head,
                              MatrixView<const Scalar> noise, MatrixView<const Scalar> actions,
                              MatrixView<const Scalar> action_gradient, Scalar log_prob_gradient,
                              MatrixView<Scalar> head_gradient);

// Scales the log_std rows of a head: log_std = m raw + b, {m, b} = `scale`; copies the mean rows.
// `scaled` has head's shape and must not overlap it.
template <typename Scalar>
void ScaleLogStd(MatrixView<const Scalar> head, std::span<const Scalar> scale,
                 MatrixView<Scalar> scaled);
// Turns d loss / d scaled in `gradient` into d loss / d head; writes scale_gradient = d loss / {d
// m, d b}.
template <typename Scalar>
void ScaleLogStdBackward(MatrixView<const Scalar> head, std::span<const Scalar> scale,
                         MatrixView<Scalar> gradient, std::span<Scalar> scale_gradient);

// The deterministic policy: actions = tanh(head), both action x n (in place allowed), and its
// backward pass head_gradient = action_gradient (1 - actions^2).
template <typename Scalar>
void TanhForward(MatrixView<const Scalar> head, MatrixView<Scalar> actions);
template <typename Scalar>
void TanhBackward(MatrixView<const Scalar> actions, MatrixView<const Scalar> action_gradient,
                  MatrixView<Scalar> head_gradient);

}  // namespace b4mrl
