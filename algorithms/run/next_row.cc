#include "algorithms/run/next_row.h"

namespace b4mrl {

MetricRow NextRow::At(uint64_t update, double seconds, uint64_t environment_steps) const {
  MetricRow row = {
      {"update", static_cast<double>(update)},
      {"environment_steps", static_cast<double>(environment_steps)},
      {"seconds", seconds},
      {"updates_per_second", static_cast<double>(update - update_) / (seconds - seconds_)},
  };
  const MetricRow means = means_.Row();
  row.insert(row.end(), means.begin(), means.end());
  return row;
}

void NextRow::Begin(uint64_t update, double seconds) {
  means_.Restart();
  update_ = update;
  seconds_ = seconds;
}

void NextRow::Save(CheckpointWriter& writer) const {
  writer.Unsigned("run/row_update", update_);
  writer.Number("run/row_seconds", seconds_);
  means_.Save(writer);
}

void NextRow::Load(CheckpointReader& reader, uint64_t update, double seconds) {
  const bool has_row = reader.Has("run/row_update");
  update_ = has_row ? reader.Unsigned("run/row_update") : update;
  seconds_ = has_row ? reader.Number("run/row_seconds") : seconds;
  means_.Load(reader);
}

}  // namespace b4mrl
