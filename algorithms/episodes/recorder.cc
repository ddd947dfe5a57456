#include "algorithms/episodes/recorder.h"

#include <cmath>
#include <numeric>
#include <utility>

namespace b4mrl {

Result<Recorder> Recorder::Create(const std::string& path, const DatasetWriterOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  return Recorder(std::move(writer), options);
}

Status Recorder::Append(const DatasetRows& rows) {
  B4MRL_RETURN_IF_ERROR(writer_.Append(rows));
  TransitionColumns columns;
  columns.rows = rows.rows;
  columns.observation_size = options_.observation_dimensions;
  columns.action_size = options_.action_dimensions;
  columns.observations = rows.observations;
  columns.actions = rows.actions;
  columns.rewards = rows.rewards;
  columns.next_observations = rows.next_observations;
  columns.terminals = rows.terminals;
  columns.timeouts = rows.timeouts;
  hash_.Append(columns);
  for (size_t i = 0; i < rows.rows; ++i) {
    episode_return_ += rows.rewards[i];
    if (rows.terminals[i] == 0 && rows.timeouts[i] == 0) continue;
    returns_.push_back(std::exchange(episode_return_, 0));
  }
  return Status();
}

RecordingSummary Recorder::Summarise() {
  RecordingSummary summary;
  summary.rows = rows();
  summary.episodes = returns_.size();
  summary.columns_sha256 = hash_.Hex();
  if (returns_.empty()) return summary;
  const auto count = static_cast<double>(returns_.size());
  summary.mean_return = std::accumulate(returns_.begin(), returns_.end(), 0.0) / count;
  double squares = 0;
  for (const double value : returns_) squares += std::pow(value - summary.mean_return, 2);
  summary.std_return = std::sqrt(squares / count);
  return summary;
}

}  // namespace b4mrl
