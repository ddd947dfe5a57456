// Transitions from which batches are drawn: one class for an online learner's experience, which
// lives in a file, and for model rollouts, which live in memory.
//
// Records have a fixed size: observation, action, next observation, reward, 1 - terminated, all
// float32. Records are numbered from 0 in the order of Append, for ever; batches are drawn from a
// window of at most `capacity` newest records.
//   In a file: append-only behind a 64-byte header, mapped into memory. Older records stay in the
//     file, so the whole experience can become a dataset later, and a checkpoint need only store
//     length(): a run that resumes writes over later records. Disk space is reserved before it is
//     mapped, so a full disk is an error and not a signal; the file ends with such space.
//   In memory: a ring.
// Thread rule: one thread. Errors: kIoError (disk, permissions), kDataLoss (a file that is shorter
// than the checkpoint says, or of other sizes), kFailedPrecondition (a ring too large to map).
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "algorithms/experience/batch_buffer.h"
#include "proto/base/rng.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

struct Transition {
  std::span<const float> observation;
  std::span<const float> action;  // in [-1, 1]
  std::span<const float> next_observation;
  float reward = 0;
  bool terminated = false;
};

class ReplayBuffer {
 public:
  struct Options {
    int observation_size = 0;
    int action_size = 0;
    uint64_t capacity = 1'000'000;  // records that can be sampled
  };

  static Result<ReplayBuffer> InMemory(const Options& options);
  // Starts an empty file, replacing any file of that name.
  static Result<ReplayBuffer> CreateFile(const std::string& path, const Options& options);
  // Takes up the first `length` records of a file; later records are dropped.
  static Result<ReplayBuffer> ResumeFile(const std::string& path, const Options& options,
                                         uint64_t length);
  ReplayBuffer(ReplayBuffer&& other) noexcept;
  ReplayBuffer& operator=(ReplayBuffer&&) = delete;
  ~ReplayBuffer();

  Status Append(const Transition& transition);
  // The window becomes [first, length()); numbers below the present window change nothing.
  void DropBefore(uint64_t first);

  uint64_t length() const { return length_; }         // records ever appended
  uint64_t size() const { return length_ - first_; }  // records in the window
  uint64_t record_bytes() const { return record_floats_ * sizeof(float); }

  // Fills columns [first_column, first_column + rows) of `batch` with rows drawn uniformly, with
  // replacement, from the window. Needs size() > 0; one draw of `rng` a row.
  void Sample(Rng& rng, int first_column, int rows, BatchBuffer& batch) const;
  // Copies record `number`, which must lie in the window, into column `column` of `batch`.
  void Get(uint64_t number, int column, BatchBuffer& batch) const;

  // Makes all records durable (files only). To be called before a checkpoint names their length.
  Status Sync();

 private:
  ReplayBuffer(const Options& options, UniqueFd fd, std::string path);
  Status Reserve(uint64_t records);  // maps memory for at least `records` records
  float* Record(uint64_t number) const;

  Options options_;
  uint64_t record_floats_ = 0;
  UniqueFd fd_;  // invalid if the buffer is in memory
  std::string path_;
  std::byte* mapping_ = nullptr;
  uint64_t mapping_bytes_ = 0;
  uint64_t reserved_ = 0;  // records that the mapping holds
  uint64_t first_ = 0;
  uint64_t length_ = 0;
};

}  // namespace b4mrl
