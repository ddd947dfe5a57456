#include "algorithms/episodes/recorder.h"

#include <utility>

#include "proto/base/mean_and_std.h"

namespace b4mrl {

Result<Recorder> Recorder::Create(const std::string& path, const DatasetWriterOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  return Recorder(std::move(writer), options);
}

Status Recorder::Append(const DatasetRows& rows) {
  B4MRL_RETURN_IF_ERROR(writer_.Append(rows));
  TransitionColumns columns = rows;
  columns.observation_size = options_.observation_dimensions;
  columns.action_size = options_.action_dimensions;
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
  const MeanAndStd figures = MeanAndStdOf(returns_);
  summary.mean_return = figures.mean;
  summary.std_return = figures.std;
  return summary;
}

}  // namespace b4mrl
