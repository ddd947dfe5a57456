// A dataset file that is being recorded, with what its rows amount to: their number, returns and
// the hash of the columns (data/columns/columns_hash.h).
//
// Returns are sums of the rewards as stored, in float32, over episodes that ended in a terminal or
// a time-out, so that whoever reads the file computes the same. Thread rule: one thread. Errors:
// those of DatasetWriter.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "data/columns/columns_hash.h"
#include "data/d4rl/dataset_file_writer.h"
#include "proto/base/status.h"

namespace b4mrl {

struct RecordingSummary {
  uint64_t rows = 0;
  uint64_t episodes = 0;  // that ended; a last episode that was cut does not count
  // Of these episodes, the population standard deviation; NaN without an episode.
  double mean_return = std::numeric_limits<double>::quiet_NaN();
  double std_return = std::numeric_limits<double>::quiet_NaN();
  std::string columns_sha256;
};

class Recorder {
 public:
  static Result<Recorder> Create(const std::string& path, const DatasetWriterOptions& options);

  Status Append(const DatasetRows& rows);
  uint64_t rows() const { return writer_.rows(); }
  // For the file's metadata, and to commit it.
  DatasetWriter& writer() { return writer_; }
  // Called once, after the last row.
  RecordingSummary Summarise();

 private:
  Recorder(DatasetWriter writer, const DatasetWriterOptions& options)
      : writer_(std::move(writer)), options_(options) {}

  DatasetWriter writer_;
  DatasetWriterOptions options_;
  ColumnsHash hash_;
  double episode_return_ = 0;  // of the episode under way
  std::vector<double> returns_;
};

}  // namespace b4mrl
