// Writes a dataset file in D4RL's HDF5 layout, in a stream, so that a million rows need little
// memory.
//
//   observations (N, obs) f32    actions (N, act) f32       next_observations (N, obs) f32
//   rewards (N) f32              terminals (N) bool         timeouts (N) bool
//   infos/action_log_probs (N) f32, infos/qpos (N, nq) f64, infos/qvel (N, nv) f64   (optional)
//   metadata/recording/...       where the rows come from (dataset_provenance.h)
//   metadata/<name>              other facts, as strings and numbers
//   metadata/policy/...          the behaviour policy (agent_file.h; optional)
//
// infos/qpos and infos/qvel are the state before the step, float64 so that it can be set exactly.
// The file appears complete or not at all (atomic_file.h). Equal rows and metadata give equal
// bytes, however the rows are split over Append calls. Thread rule: one thread. Errors:
// kInvalidArgument (array sizes), kIoError (full disk, no folder).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "data/columns/dataset.h"
#include "data/d4rl/agent_file.h"
#include "data/d4rl/dataset_provenance.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetWriterOptions {
  uint32_t observation_dimensions = 0;
  uint32_t action_dimensions = 0;
  uint32_t qpos_dimensions = 0;   // 0: no infos/qpos
  uint32_t qvel_dimensions = 0;   // 0: no infos/qvel
  bool action_log_probs = false;  // true: infos/action_log_probs
  int compression_level = 1;      // deflate 0..9; D4RL's own files use 4
};

// Consecutive rows of a dataset. Every array is row-major and must have `rows` rows. Optional
// arrays that DatasetWriterOptions leave out must be empty. The sizes of an observation and an
// action are those of DatasetWriterOptions; the writer does not read them here.
struct DatasetRows : TransitionColumns {
  std::span<const float> action_log_probs;
  std::span<const double> qpos;
  std::span<const double> qvel;
};

class DatasetWriter {
 public:
  static Result<DatasetWriter> Create(const std::string& path, const DatasetWriterOptions& options);

  Status Append(const DatasetRows& rows);
  // Writes metadata/<name>. Each name may be written once.
  Status SetMetadata(std::string_view name, std::string_view text);
  Status SetMetadata(std::string_view name, int64_t value);
  // Writes metadata/recording and metadata/license.
  Status SetProvenance(const DatasetProvenance& provenance);
  // Writes D4RL's metadata of a behaviour policy: the agent's provenance and weights.
  Status SetPolicy(const Agent& agent);
  // Makes the file appear. Nothing may be called afterwards.
  Status Commit(Existing existing = Existing::kReplace);

  uint64_t rows() const { return rows_; }

 private:
  DatasetWriter(Hdf5Writer file, const DatasetWriterOptions& options);
  Status CreateColumns();
  Status CheckSizes(const DatasetRows& rows) const;

  Hdf5Writer file_;
  DatasetWriterOptions options_;
  uint64_t rows_ = 0;
  std::array<Hdf5Writer::ColumnId, 9> ids_{};  // the columns' ids, in the order of the file
};

}  // namespace b4mrl
