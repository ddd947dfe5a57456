// Reads a dataset file in D4RL's layout (dataset_file_writer.h) block by block, outside the
// importer's sandbox, for a command whose user names the file.
//
// Accepts what the importer accepts (import_dataset.h), but for missing next_observations. Missing
// timeouts read as none. Thread rule: one thread. Errors: as hdf5_file.h, and kInvalidArgument for
// columns whose sizes contradict each other.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "data/d4rl/dataset_file_writer.h"
#include "data/d4rl/dataset_provenance.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// Entry metadata/<name> of a recording that was made from an action log (action_log.h): the number
// of the first episode in the training run, from 0. A file without it has whole episodes, each of
// them started from a seed of its own.
inline constexpr char kReplayFirstEpisode[] = "replay_first_episode";

// Consecutive rows, row-major.
struct DatasetBlock {
  DatasetRows view() const;

  std::vector<float> observations, actions, next_observations, rewards;
  std::vector<uint8_t> terminals, timeouts;
  std::vector<double> qpos, qvel;  // empty unless the file has both
};

class DatasetFileReader {
 public:
  static Result<DatasetFileReader> Open(const std::string& path);

  uint64_t rows() const { return rewards_.rows(); }
  uint32_t observation_size() const { return static_cast<uint32_t>(observations_.width()); }
  uint32_t action_size() const { return static_cast<uint32_t>(actions_.width()); }
  // The numbers that Read brings for each row, but for rewards and ends of episodes.
  uint64_t row_numbers() const {
    const uint64_t states = has_states() ? qpos_->width() + qvel_->width() : 0;
    return observations_.width() + actions_.width() + next_observations_.width() + states;
  }
  // Whether the file has infos/qpos and infos/qvel.
  bool has_states() const { return qpos_ && qvel_; }
  const DatasetProvenance& provenance() const { return provenance_; }
  std::optional<uint64_t> replay_first_episode() const { return first_episode_; }

  // Reads `count` rows from row `first` on; they must exist.
  Result<DatasetBlock> Read(uint64_t first, uint64_t count) const;

 private:
  DatasetFileReader(Hdf5Column observations, Hdf5Column actions, Hdf5Column next_observations,
                    Hdf5Column rewards, Hdf5Column terminals);
  Status CheckSizes() const;

  Hdf5Column observations_, actions_, next_observations_, rewards_, terminals_;
  std::optional<Hdf5Column> timeouts_, qpos_, qvel_;
  DatasetProvenance provenance_;
  std::optional<uint64_t> first_episode_;
};

}  // namespace b4mrl
