// A learner's whole state in one HDF5 file that appears complete or not at all.
//
// Names are "/"-separated paths. Reader and writer remember their first error and then do nothing
// more, so a learner lists its state line by line and asks for the status once at the end. Big data
// does not belong here: of a replay file, a checkpoint stores the length
// (experience/replay_buffer.h). Thread rule: one thread. Errors: as data/hdf5/hdf5_file.h;
// kDataLoss also when a stored array has another size than the learner's, or an integer, a counter
// or a byte is no whole number of its range.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/nn/parameters.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/status.h"

namespace b4mrl {

class CheckpointWriter {
 public:
  static Result<CheckpointWriter> Create(const std::string& path);

  void Integer(std::string_view name, int64_t value);    // 0..2^53, which the reader takes
  void Unsigned(std::string_view name, uint64_t value);  // all 64 bits
  void Number(std::string_view name, double value);
  void Text(std::string_view name, std::string_view text);
  // Floats and Bytes also store empty arrays.
  void Floats(std::string_view name, std::span<const float> values);
  void Bytes(std::string_view name, std::span<const uint8_t> values);
  // Visitors that store each array and each counter of a core under "<prefix>/".
  ArrayVisitor<float> Arrays(std::string prefix);
  CounterVisitor Counters(std::string prefix);
  // Stores all arrays and counters of `core` under "<prefix>/".
  template <typename Core>
  void State(const std::string& prefix, Core& core) {
    core.VisitArrays(Arrays(prefix));
    core.VisitCounters(Counters(prefix));
  }
  // Name of the first array with a value that is not finite, which shows that the learner diverged.
  const std::optional<std::string>& first_nonfinite() const { return first_nonfinite_; }

  // Flushes and fsyncs the file and renames it into place, or returns the first error.
  Status Commit();

 private:
  explicit CheckpointWriter(Hdf5Writer file) : file_(std::move(file)) {}
  void Note(Status status) {
    if (status_.ok()) status_ = std::move(status);
  }

  Hdf5Writer file_;
  Status status_;
  std::optional<std::string> first_nonfinite_;
};

class CheckpointReader {
 public:
  static Result<CheckpointReader> Open(const std::string& path);

  // Whether `name` is stored; checkpoints of older program versions lack newer names.
  bool Has(std::string_view name) const { return file_.Exists(name); }
  int64_t Integer(std::string_view name);
  uint64_t Unsigned(std::string_view name);
  double Number(std::string_view name);
  std::string Text(std::string_view name);
  std::vector<float> Floats(std::string_view name);
  // Reads an array of floats into `out`, which must have the stored length.
  void FloatsInto(std::string_view name, std::span<float> out);
  std::vector<uint8_t> Bytes(std::string_view name);
  ArrayVisitor<float> Arrays(std::string prefix);
  CounterVisitor Counters(std::string prefix);
  // Reads all arrays and counters of `core` from under "<prefix>/".
  template <typename Core>
  void StateInto(const std::string& prefix, Core& core) {
    core.VisitArrays(Arrays(prefix));
    core.VisitCounters(Counters(prefix));
  }

  const Status& status() const { return status_; }

 private:
  explicit CheckpointReader(Hdf5Reader file) : file_(std::move(file)) {}
  template <typename T>
  T Take(Result<T> result) {
    if (result.ok()) return std::move(result).value();
    if (status_.ok()) status_ = result.status();
    return T{};
  }

  Hdf5Reader file_;
  Status status_;
};

// Path of a run's checkpoint after `update` updates: "<folder>/checkpoint-<update>.h5".
std::string CheckpointPath(const std::string& folder, uint64_t update);
// Update numbers of the checkpoints in `folder`, newest first; none if there is no such folder.
// kIoError if it cannot be read: it may hold a run.
Result<std::vector<uint64_t>> ListCheckpoints(const std::string& folder);
// Removes all checkpoints in `folder` but the newest two, as far as it can: those that stay cost
// disk space only.
void RemoveOldCheckpoints(const std::string& folder);
// Renames checkpoints of later updates to "<folder>/unreadable-checkpoint-<update>.h5", which no
// function here lists. What cannot be renamed stays.
void SetAsideCheckpointsAfter(uint64_t update, const std::string& folder);

}  // namespace b4mrl
