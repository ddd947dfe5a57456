// What a run measures: means between two log lines, and the two log files.
//
// progress.csv has one column per name of the first row; metrics.jsonl one object a line. A value
// that was not measured is NaN in a row, an empty cell in the CSV and absent from the JSON. Each
// row is written whole by one write call, so that a reader never sees half a line; a resumed run
// cuts both files back to the offsets its checkpoint names. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "algorithms/nn/checkpoint.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

struct Metric {
  std::string name;
  double value;
};
using MetricRow = std::vector<Metric>;

// Means since the last Take, in the order in which names first appeared.
class MetricMeans {
 public:
  void Add(std::string_view name, double value);
  // None, one or several values. Gives the name its place in the order even without a value.
  void AddAll(std::string_view name, std::span<const double> values);
  MetricRow Take();
  // The first value that was not finite since construction: a learner that diverged.
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

class MetricsLog {
 public:
  struct Offsets {
    uint64_t csv_bytes = 0;
    uint64_t json_bytes = 0;
  };

  // Opens both files in `folder`, cut to `offsets` (zero: new files).
  static Result<MetricsLog> Open(const std::string& folder, const Offsets& offsets);

  // The first row of a new file decides the CSV's columns; later rows must have the same names.
  Status Write(const MetricRow& row);
  Offsets offsets() const { return offsets_; }
  // Makes what was written durable.
  Status Sync();

 private:
  MetricsLog(UniqueFd csv, UniqueFd json, Offsets offsets)
      : csv_(std::move(csv)), json_(std::move(json)), offsets_(offsets) {}

  UniqueFd csv_;
  UniqueFd json_;
  Offsets offsets_;
};

}  // namespace b4mrl
