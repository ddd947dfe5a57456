// The next row of a run's logs: means over the updates since the row before, and where that one
// was.
//
// A row is made and written before the one after it begins, so that a row whose write failed is
// still in the run's checkpoint, and the resumed run writes it.
// Thread rule: one thread.
#pragma once

#include <cstdint>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/metrics.h"

namespace b4mrl {

class NextRow {
 public:
  MetricMeans& means() { return means_; }
  const MetricMeans& means() const { return means_; }
  // Whether the row before is that of `update`. Before the first row this is true of update 0.
  bool Follows(uint64_t update) const { return update_ == update; }

  // The row at `update`, `seconds` seconds into the run.
  MetricRow At(uint64_t update, double seconds, uint64_t environment_steps) const;
  // Begins the row after the one At `update` and `seconds`; also sets where the updates begin.
  void Begin(uint64_t update, double seconds);

  void Save(CheckpointWriter& writer) const;
  // Checkpoints of older program versions lack the row before: they were written after the row of
  // their own update and seconds, which are given here.
  void Load(CheckpointReader& reader, uint64_t update, double seconds);

 private:
  MetricMeans means_;
  // Update and seconds of the row before, or of the beginning of the updates.
  uint64_t update_ = 0;
  double seconds_ = 0;
};

}  // namespace b4mrl
