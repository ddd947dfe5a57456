// The lengths of a dataset's episodes, found by reading its rows once from start to end.
//
// A Minari episode of T rows has T + 1 observations, so it cannot hold rows whose next observation
// is anything but the observation of the next row. This first pass refuses those rows before a file
// is begun. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <vector>

#include "data/d4rl/dataset_file_writer.h"
#include "proto/base/status.h"

namespace b4mrl {

// The most episodes that are written as Minari episodes or read from them.
inline constexpr uint64_t kMaxMinariEpisodes = 1'000'000;

class EpisodeLengths {
 public:
  // Appends the next rows of the dataset. kFailedPrecondition, naming the row, if a row that does
  // not end an episode has a next observation other than the next row's observation, bit for bit.
  // kLimitExceeded for more than kMaxMinariEpisodes episodes.
  Status Append(const DatasetRows& rows);

  // Rows of each episode, in order. The last episode may be unfinished.
  const std::vector<uint64_t>& lengths() const { return lengths_; }
  uint64_t rows() const { return rows_; }
  // Whether the last row is neither a terminal nor a time-out.
  bool last_is_unfinished() const { return in_episode_; }

 private:
  std::vector<uint64_t> lengths_;
  std::vector<float> next_observation_;  // of the row before
  uint64_t rows_ = 0;
  bool in_episode_ = false;  // whether the row before left its episode unfinished
};

}  // namespace b4mrl
