// The SIMD kernels of policy/inference.h, in a translation unit of their own because they are
// compiled for x86-64-v3 whatever the rest of algorithms/ is compiled for. Internal to
// policy/inference.cc.
//
// A layer's weights are packed in panels of kPanel outputs: panel p holds, for each input k, the
// weights of outputs [kPanel p, kPanel p + kPanel), zero beyond the last output. Activations have
// one row per observation, and row strides that are multiples of kPanel numbers.
#pragma once

#include <cstddef>

namespace b4mrl::inference {

inline constexpr int kPanel = 16;

constexpr int Padded(int count) { return (count + kPanel - 1) / kPanel * kPanel; }

// output[row][o] = bias[o] + sum_k weight[o][k] input[row][k], then max(., 0) if `relu`. Every
// output is one chain of fused multiply-adds in the order of k. `weights` has Padded(outputs) *
// inputs numbers, `bias` Padded(outputs).
void Dense(const float* weights, const float* bias, int inputs, int outputs, bool relu,
           const float* input, int input_stride, int rows, float* output, int output_stride);

// True if none of the `count` values is NaN or infinite.
bool AllFinite(const float* values, std::size_t count);

// values[i] = tanh(values[i]) for i in [0, Padded(count)).
void TanhInPlace(int count, float* values);

// mean[i] = tanh(mean[i] + exp(clamp(log_std[i], low, high)) * noise[i]) for i in [0,
// Padded(count)); terms[i] = term i of the action's log density in FixedOrderPolicy::Sample.
void SquashSample(int count, float low, float high, const float* log_std, const float* noise,
                  float* mean, float* terms);

}  // namespace b4mrl::inference
