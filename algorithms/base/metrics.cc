#include "algorithms/base/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace b4mrl {

MetricMeans::Sum& MetricMeans::SumOf(std::string_view name) {
  auto sum = std::find_if(sums_.begin(), sums_.end(), [&](const Sum& s) { return s.name == name; });
  if (sum == sums_.end()) sum = sums_.insert(sums_.end(), {std::string(name)});
  return *sum;
}

void MetricMeans::Add(std::string_view name, double value) { AddAll(name, {&value, 1}); }

void MetricMeans::AddAll(std::string_view name, std::span<const double> values) {
  Sum& sum = SumOf(name);
  for (const double value : values) {
    if (!std::isfinite(value) && !first_nonfinite_) first_nonfinite_ = {std::string(name), value};
    sum.sum += value;
    ++sum.count;
  }
}

MetricRow MetricMeans::Row() const {
  MetricRow row;
  for (const Sum& sum : sums_) {
    const double mean =
        sum.count > 0 ? sum.sum / sum.count : std::numeric_limits<double>::quiet_NaN();
    row.push_back({sum.name, mean});
  }
  return row;
}

void MetricMeans::Restart() {
  for (Sum& sum : sums_) {
    sum.sum = 0;
    sum.count = 0;
  }
}

void MetricMeans::Save(CheckpointWriter& writer) const {
  writer.Integer("metrics/count", static_cast<int64_t>(sums_.size()));
  for (size_t i = 0; i < sums_.size(); ++i) {
    writer.Text(fmt::format("metrics/{}/name", i), sums_[i].name);
    writer.Number(fmt::format("metrics/{}/sum", i), sums_[i].sum);
    writer.Integer(fmt::format("metrics/{}/values", i), sums_[i].count);
  }
}

void MetricMeans::Load(CheckpointReader& reader) {
  sums_.clear();
  const int64_t count = reader.Integer("metrics/count");
  for (int64_t i = 0; i < count && reader.status().ok(); ++i) {
    sums_.push_back({reader.Text(fmt::format("metrics/{}/name", i)),
                     reader.Number(fmt::format("metrics/{}/sum", i)),
                     reader.Integer(fmt::format("metrics/{}/values", i))});
  }
}

}  // namespace b4mrl
