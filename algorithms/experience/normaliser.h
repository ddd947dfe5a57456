// (observation - mean) / std, from a dataset's statistics. Value type; no thread rule.
#pragma once

#include <span>
#include <vector>

#include "algorithms/nn/products/view.h"
#include "client/remote_dataset.h"

namespace b4mrl {

struct Normaliser {
  std::vector<float> mean;
  std::vector<float> std;

  // `epsilon` is added to each standard deviation, so that a constant dimension becomes 0 and not
  // NaN.
  static Normaliser Of(const DatasetStats& stats, double epsilon) {
    Normaliser normaliser;
    for (const double mean : stats.observation_mean) {
      normaliser.mean.push_back(static_cast<float>(mean));
    }
    for (const double std : stats.observation_std) {
      normaliser.std.push_back(static_cast<float>(std + epsilon));
    }
    return normaliser;
  }

  // Normalises `rows`, row-major with one observation a row, into the columns of `out`.
  void Apply(std::span<const float> rows, MatrixView<float> out) const {
    const size_t size = mean.size();
    for (int column = 0; column < out.columns; ++column) {
      const float* row = rows.data() + static_cast<size_t>(column) * size;
      float* normalised = out.column(column);
      for (size_t i = 0; i < size; ++i) normalised[i] = (row[i] - mean[i]) / std[i];
    }
  }
};

}  // namespace b4mrl
