// The three log files of one run, which hold the same rows:
//
//   metrics.jsonl              one JSON object per row, with the learner's own names of metrics
//   progress.csv               a table with the names of Stable-Baselines3's CSV logger
//   events.out.tfevents.b4mrl  TensorBoard's event file: charts/..., ledger/..., losses/...
//
// A value that was not measured is NaN in a row, an empty cell of the CSV and absent elsewhere. A
// resumed run cuts metrics.jsonl and the event file back to the lengths in its checkpoint.
// progress.csv is written anew from metrics.jsonl on resuming and when a row brings a new column.
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

// A metric's name in TensorBoard: "critic_loss" -> "losses/critic_loss", "episodic_return" ->
// "charts/episodic_return".
std::string TagOf(std::string_view name);
// A metric's column in progress.csv: "critic_loss" -> "train/critic_loss", "episodic_return" ->
// "rollout/ep_rew_mean".
std::string ColumnOf(std::string_view name);

class MetricsLog {
 public:
  // Lengths of metrics.jsonl and of the event file.
  struct Offsets {
    uint64_t json_bytes = 0;
    uint64_t event_bytes = 0;
  };

  // Opens the logs in `folder`, cut to `offsets`; 0: new files.
  static Result<MetricsLog> Open(const std::string& folder, const Offsets& offsets);

  // Appends a row to all three files. The row's first value is the number of the update. After an
  // error no other row may be written: a part of this one may be in the files, beyond offsets().
  Status Write(const MetricRow& row);
  // The lengths with the rows that were written whole.
  Offsets offsets() const { return written_; }
  // Makes the rows in metrics.jsonl and in the event file durable (fsync).
  Status Sync();

 private:
  MetricsLog(std::string folder, AppendedFile json, EventFile events)
      : folder_(std::move(folder)),
        json_(std::move(json)),
        events_(std::move(events)),
        written_(Present()) {}
  Offsets Present() const { return {json_.bytes(), events_.bytes()}; }
  // Gives every name in `row` a column; returns whether that added a column.
  bool AddColumns(const MetricRow& row);
  std::string TableLine(const MetricRow& row) const;
  Status RewriteTable();
  std::string JsonPath() const { return folder_ + "/metrics.jsonl"; }
  std::string TablePath() const { return folder_ + "/progress.csv"; }

  std::string folder_;
  AppendedFile json_;
  EventFile events_;
  Offsets written_;
  std::optional<AppendedFile> table_;  // progress.csv
  std::vector<std::string> columns_;   // metrics of progress.csv's columns, in order: "critic_loss"
};

}  // namespace b4mrl
