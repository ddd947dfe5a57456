// An interval for a figure of values that come in groups, which are drawn as wholes: values of one
// group, such as the rankings of one dataset, are not independent. Pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/statistics/bootstrap.h"
#include "proto/base/rng.h"

namespace b4mrl {

// The percentile interval of 95% over 2,000 resamples of the groups; values[i] belongs to
// groups[i]. Nothing with fewer than two groups, or where most resamples have no such figure.
template <typename Value>
std::optional<Interval> IntervalOverGroups(
    const std::vector<Value>& values,
    std::optional<double> (*summarise)(const std::vector<Value>&),
    const std::vector<std::string>& groups) {
  constexpr size_t kResamples = 2000;
  constexpr double kConfidence = 0.95;
  std::map<std::string, std::vector<Value>> by_group;
  for (size_t i = 0; i < values.size(); ++i) by_group[groups[i]].push_back(values[i]);
  if (by_group.size() < 2) return std::nullopt;
  std::vector<std::vector<Value>> grouped;
  for (auto& [name, members] : by_group) grouped.push_back(std::move(members));
  std::vector<std::vector<double>> estimates;
  for (uint64_t number = 0; number < kResamples; ++number) {
    Rng random(0, "resample of the agreement", number);
    std::vector<Value> drawn;
    for (size_t i = 0; i < grouped.size(); ++i) {
      const std::vector<Value>& members = grouped[random.Below(grouped.size())];
      drawn.insert(drawn.end(), members.begin(), members.end());
    }
    if (const auto each = summarise(drawn)) estimates.push_back({*each});
  }
  if (estimates.size() <= kResamples / 2) return std::nullopt;
  return PercentileIntervals(estimates, kConfidence).front();
}

}  // namespace b4mrl
