// The logs of one run, from the same rows:
//
//   metrics.jsonl              one JSON object for each row, under the learner's own names
//   progress.csv               the same under the names of Stable-Baselines3's CSV logger
//   events.out.tfevents.b4mrl  the same for TensorBoard: charts/..., losses/...
//
// A value that was not measured is NaN in a row, an empty cell of the CSV and absent elsewhere. A
// resumed run cuts metrics.jsonl and the event file back to what its checkpoint saw and writes
// progress.csv anew from metrics.jsonl, as it also does when a row brings a new column.
// Thread rule: one thread. Errors: run/appended_file.h, data/files/atomic_file.h.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/metrics.h"
#include "algorithms/run/appended_file.h"
#include "algorithms/run/event_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// "critic_loss" -> "losses/critic_loss", "episodic_return" -> "charts/episodic_return".
std::string TagOf(std::string_view name);
// "critic_loss" -> "train/critic_loss", "episodic_return" -> "rollout/ep_rew_mean".
std::string ColumnOf(std::string_view name);

class MetricsLog {
 public:
  struct Offsets {
    uint64_t json_bytes = 0;
    uint64_t event_bytes = 0;
  };

  // Opens the logs in `folder`, cut to `offsets` (zero: new files).
  static Result<MetricsLog> Open(const std::string& folder, const Offsets& offsets);

  // Appends one row to all three logs; its first value is the number of its update.
  Status Write(const MetricRow& row);
  Offsets offsets() const { return {json_.bytes(), events_.bytes()}; }
  // Returns once everything written is on disk.
  Status Sync();

 private:
  MetricsLog(std::string folder, AppendedFile json, EventFile events)
      : folder_(std::move(folder)), json_(std::move(json)), events_(std::move(events)) {}
  // Gives every name of `row` a column of progress.csv; true when a name was new.
  bool AddColumns(const MetricRow& row);
  std::string TableLine(const MetricRow& row) const;
  Status RewriteTable();
  std::string JsonPath() const { return folder_ + "/metrics.jsonl"; }
  std::string TablePath() const { return folder_ + "/progress.csv"; }

  std::string folder_;
  AppendedFile json_;
  EventFile events_;
  std::optional<AppendedFile> table_;  // progress.csv
  std::vector<std::string> columns_;   // names of its columns, in order; "critic_loss"
};

}  // namespace b4mrl
