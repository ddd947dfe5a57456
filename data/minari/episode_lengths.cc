#include "data/minari/episode_lengths.h"

#include <fmt/format.h>

#include <cstring>

namespace b4mrl {

Status EpisodeLengths::Append(const DatasetRows& rows) {
  const size_t width = rows.rows == 0 ? 0 : rows.observations.size() / rows.rows;
  std::span<const float> expected = next_observation_;
  for (size_t row = 0; row < rows.rows; ++row) {
    const std::span<const float> observation = rows.observations.subspan(row * width, width);
    if (in_episode_ &&
        std::memcmp(expected.data(), observation.data(), width * sizeof(float)) != 0) {
      return Status(StatusCode::kFailedPrecondition,
                    fmt::format("the next observation of row {} is not the observation of row {}, "
                                "and neither a terminal nor a time-out lies between them; Minari "
                                "keeps one observation for both",
                                rows_ - 1, rows_));
    }
    if (!in_episode_) {
      if (lengths_.size() == kMaxMinariEpisodes) {
        return Status(StatusCode::kLimitExceeded,
                      fmt::format("the dataset has more than {} episodes", kMaxMinariEpisodes));
      }
      lengths_.push_back(0);
    }
    ++lengths_.back();
    ++rows_;
    in_episode_ = rows.terminals[row] == 0 && rows.timeouts[row] == 0;
    expected = rows.next_observations.subspan(row * width, width);
  }
  if (rows.rows > 0) next_observation_.assign(expected.begin(), expected.end());
  return Status();
}

}  // namespace b4mrl
