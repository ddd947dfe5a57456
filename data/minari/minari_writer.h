// Writes a dataset in the layout of Minari 0.5, in a stream, so that episodes of any length need
// little memory.
//
//   <root>/<id>/data/main_data.hdf5   for each episode k of T rows the group episode_<k>:
//     observations (T + 1, obs) f32   actions (T, act) f32   rewards (T) f32
//     terminations (T) bool           truncations (T) bool   infos, an empty group
//     attributes id, total_steps
//   <root>/<id>/data/metadata.json    minari_metadata.h
//   <root>/<namespace>/namespace_metadata.json   of each namespace of the id, if there is none
//
// An unfinished last episode is marked as truncated. The folder <root>/<id> appears complete or not
// at all (atomic_folder.h); one that exists is refused. Thread rule: one thread. Errors: kIoError,
// kFailedPrecondition, kInvalidArgument (arrays whose sizes do not fit).
#pragma once

#include <cstdint>
#include <string>

#include "data/d4rl/dataset_file_writer.h"
#include "data/files/atomic_folder.h"
#include "data/hdf5/hdf5_file.h"
#include "data/minari/episode_lengths.h"
#include "data/minari/minari_metadata.h"
#include "proto/base/status.h"

namespace b4mrl {

class MinariWriter {
 public:
  // Begins the dataset `id` in the folder `root`, where the folder of its namespace must exist.
  // `episodes` are those of the rows that Append will be given.
  static Result<MinariWriter> Create(const std::string& root, const std::string& id,
                                     EpisodeLengths episodes);

  // Appends the next rows: observations, actions, next observations, rewards, terminals, timeouts.
  Status Append(const DatasetRows& rows);
  // Makes the folder appear, once all rows are appended. Sets the id, the numbers of rows and
  // episodes and last_is_unfinished of `description`. Nothing may be called afterwards.
  Status Commit(MinariDescription description);

  uint64_t rows() const { return rows_; }

 private:
  MinariWriter(std::string root, std::string id, EpisodeLengths episodes, AtomicFolder folder,
               Hdf5Writer file);
  std::string DataFolder() const { return folder_.temporary_path() + "/data"; }
  Status BeginEpisode(uint64_t observation_size, uint64_t action_size);
  Status WriteNamespaces() const;

  std::string root_, id_;
  EpisodeLengths episodes_;
  AtomicFolder folder_;
  Hdf5Writer file_;
  uint64_t rows_ = 0;
  uint64_t episode_ = 0;         // number of the episode that the next row belongs to
  uint64_t row_in_episode_ = 0;  // of the next row
};

}  // namespace b4mrl
