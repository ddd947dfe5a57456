#include "data/columns/statistics.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string FormatNumbers(std::span<const double> values) {
  return fmt::format("{}", fmt::join(values, " "));
}

// Reads numbers that FormatNumbers wrote: shortest round-trip decimals, "nan" and "inf", separated
// by spaces.
Result<std::vector<double>> NumbersOf(const CacheProperties& properties, std::string_view name) {
  const auto found = properties.find(name);
  if (found == properties.end()) {
    return Status(StatusCode::kDataLoss, fmt::format("property '{}' is missing", name));
  }
  std::string_view text = found->second;
  std::vector<double> values;
  while (!text.empty()) {
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc()) {
      return Status(StatusCode::kDataLoss, fmt::format("property '{}' is not numbers", name));
    }
    values.push_back(value);
    text.remove_prefix(static_cast<size_t>(end - text.data()));
    if (!text.empty()) text.remove_prefix(1);
  }
  return values;
}

}  // namespace

void Moments::Add(double value) {
  ++count_;
  const double difference = value - mean_;
  mean_ += difference / static_cast<double>(count_);
  squares_ += difference * (value - mean_);
  if (count_ == 1 || value < min_) min_ = value;
  if (count_ == 1 || value > max_) max_ = value;
}

// A NaN makes all of these NaN: minimum and maximum would miss it, since comparisons with NaN are
// false. An infinity makes the standard deviation NaN, and the mean infinite; with the next value
// the mean, and so minimum and maximum, become NaN, too, since infinity - infinity is NaN.
double Moments::mean() const { return count_ == 0 ? kNaN : mean_; }
double Moments::std() const {
  return count_ == 0 ? kNaN : std::sqrt(squares_ / static_cast<double>(count_));
}
double Moments::min() const { return count_ == 0 || std::isnan(mean_) ? kNaN : min_; }
double Moments::max() const { return count_ == 0 || std::isnan(mean_) ? kNaN : max_; }

void StatisticsAccumulator::AddObservations(std::span<const float> observations) {
  const size_t size = observations_.size();
  for (size_t first = 0; first + size <= observations.size(); first += size) {
    for (size_t i = 0; i < size; ++i) observations_[i].Add(observations[first + i]);
  }
}

void StatisticsAccumulator::AddRewards(std::span<const float> rewards,
                                       std::span<const uint8_t> terminals,
                                       std::span<const uint8_t> timeouts) {
  for (size_t row = 0; row < rewards.size(); ++row) {
    rewards_.Add(rewards[row]);
    open_return_ += rewards[row];
    episode_open_ = true;
    if (terminals[row] == 0 && timeouts[row] == 0) continue;
    returns_.Add(open_return_);
    ++episodes_;
    open_return_ = 0;
    episode_open_ = false;
  }
}

DatasetStatistics StatisticsAccumulator::Finish() const {
  DatasetStatistics statistics;
  for (const Moments& moments : observations_) {
    statistics.observation_mean.push_back(moments.mean());
    statistics.observation_std.push_back(moments.std());
  }
  statistics.episodes = episodes_ + (episode_open_ ? 1 : 0);
  statistics.mean_return = returns_.mean();
  statistics.std_return = returns_.std();
  statistics.min_return = returns_.min();
  statistics.max_return = returns_.max();
  statistics.min_reward = rewards_.min();
  statistics.max_reward = rewards_.max();
  return statistics;
}

void StoreStatistics(const DatasetStatistics& statistics, ColumnCacheWriter* cache) {
  cache->SetProperty("observation_mean", FormatNumbers(statistics.observation_mean));
  cache->SetProperty("observation_std", FormatNumbers(statistics.observation_std));
  const double returns[] = {statistics.mean_return, statistics.std_return, statistics.min_return,
                            statistics.max_return};
  const double rewards[] = {statistics.min_reward, statistics.max_reward};
  const auto episodes = static_cast<double>(statistics.episodes);
  cache->SetProperty("returns_mean_std_min_max", FormatNumbers(returns));
  cache->SetProperty("rewards_min_max", FormatNumbers(rewards));
  cache->SetProperty("episodes", FormatNumbers(std::span(&episodes, 1)));
}

Result<DatasetStatistics> LoadStatistics(const CacheProperties& properties) {
  DatasetStatistics statistics;
  B4MRL_ASSIGN_OR_RETURN(statistics.observation_mean, NumbersOf(properties, "observation_mean"));
  B4MRL_ASSIGN_OR_RETURN(statistics.observation_std, NumbersOf(properties, "observation_std"));
  B4MRL_ASSIGN_OR_RETURN(const std::vector<double> returns,
                         NumbersOf(properties, "returns_mean_std_min_max"));
  B4MRL_ASSIGN_OR_RETURN(const std::vector<double> rewards,
                         NumbersOf(properties, "rewards_min_max"));
  B4MRL_ASSIGN_OR_RETURN(const std::vector<double> episodes, NumbersOf(properties, "episodes"));
  const bool complete = returns.size() == 4 && rewards.size() == 2 && episodes.size() == 1 &&
                        episodes[0] >= 0 && episodes[0] <= limits::kMaxDatasetRows &&
                        statistics.observation_mean.size() == statistics.observation_std.size();
  if (!complete) return Status(StatusCode::kDataLoss, "the statistics are incomplete");
  statistics.mean_return = returns[0];
  statistics.std_return = returns[1];
  statistics.min_return = returns[2];
  statistics.max_return = returns[3];
  statistics.min_reward = rewards[0];
  statistics.max_reward = rewards[1];
  statistics.episodes = static_cast<uint64_t>(episodes[0]);
  return statistics;
}

}  // namespace b4mrl
