// Metrics of a run: means over the updates between two rows of its logs (run/metrics_log.h).
// Thread rule: one thread.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"

namespace b4mrl {

struct Metric {
  std::string name;
  double value;  // NaN: not measured
};
using MetricRow = std::vector<Metric>;

// Means since the last Restart, in the order in which names first appeared.
class MetricMeans {
 public:
  void Add(std::string_view name, double value);
  // Adds any number of values. Gives the name its place in the order even if `values` is empty.
  void AddAll(std::string_view name, std::span<const double> values);
  MetricRow Row() const;
  // Keeps the names and their order.
  void Restart();
  // The first value since construction that was not finite; it shows that the learner diverged.
  const std::optional<Metric>& first_nonfinite() const { return first_nonfinite_; }

  void Save(CheckpointWriter& writer) const;
  void Load(CheckpointReader& reader);

 private:
  struct Sum {
    std::string name;
    double sum = 0;
    int64_t count = 0;
  };
  Sum& SumOf(std::string_view name);

  std::vector<Sum> sums_;
  std::optional<Metric> first_nonfinite_;
};

}  // namespace b4mrl
