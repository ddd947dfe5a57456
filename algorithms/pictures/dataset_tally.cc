#include "algorithms/pictures/dataset_tally.h"

#include <algorithm>
#include <cmath>

#include "algorithms/pictures/axis.h"

namespace b4mrl {
namespace {

// Adds row-major `rows` to `columns`, each value to that of its column.
template <typename Column>
void AddRows(std::span<const float> rows, std::vector<Column>* columns) {
  const size_t size = columns->size();
  for (size_t first = 0; size > 0 && first + size <= rows.size(); first += size) {
    for (size_t i = 0; i < size; ++i) (*columns)[i].Add(rows[first + i]);
  }
}

// At most `most` bins of a round width between round edges, for numbers from `low` to `high`; one
// bin if there are none.
Histogram RoundBins(double low, double high, double most) {
  if (low > high) return {0, 1, 1};
  const AxisRange range = AxisRange::Around(low, high);
  // Rounding the edges outwards can add a bin on each side.
  const double width = RoundStep((range.high - range.low) / (most - 2));
  const double first = std::floor(range.low / width), last = std::ceil(range.high / width);
  return {first * width, last * width, static_cast<size_t>(last - first)};
}

// Bins for one dimension of one or two datasets.
Histogram DimensionBins(const NumberRange& a, const NumberRange& b) {
  constexpr double kMostBins = 80;
  return RoundBins(std::min(a.low(), b.low()), std::max(a.high(), b.high()), kMostBins);
}

// At most twice as many bins as the square root of the number of returns, within 12 to 80: a few
// failed episodes often make the range ten times as wide as that of all others.
Histogram ReturnBins(const NumberRange& returns) {
  const double most = std::clamp(2 * std::sqrt(static_cast<double>(returns.finite())), 12.0, 80.0);
  return RoundBins(returns.low(), returns.high(), most);
}

}  // namespace

template <typename Use>
void DatasetTally::ForEachReturn(const RowBlock& block, const Use& use) {
  for (size_t row = 0; row < block.rewards.size(); ++row) {
    episode_.sum += block.rewards[row];
    episode_.is_open = block.terminals[row] == 0 && block.timeouts[row] == 0;
    if (episode_.is_open) continue;
    use(episode_.sum);
    episode_ = {};
  }
}

void DatasetTally::Measure(const RowBlock& block) {
  rows_ += block.rewards.size();
  AddRows(block.observations, &observations_);
  AddRows(block.actions, &actions_);
  ForEachReturn(block, [&](double value) { returns_.Add(value); });
}

void DatasetTally::PrepareBins(const DatasetTally* other) {
  for (size_t i = 0; i < observations_.size(); ++i) {
    const NumberRange& own = observations_[i];
    observation_bins_.push_back(DimensionBins(own, other ? other->observations_[i] : own));
  }
  for (const NumberRange& range : actions_) action_bins_.push_back(DimensionBins(range, range));
  return_bins_ = ReturnBins(returns_);
  episode_ = {};
}

void DatasetTally::Count(const RowBlock& block) {
  AddRows(block.observations, &observation_bins_);
  AddRows(block.actions, &action_bins_);
  ForEachReturn(block, [&](double value) { return_bins_.Add(value); });
}

}  // namespace b4mrl
