// Reads a Minari dataset (minari_writer.h has the layout) episode by episode, for a command whose
// user names the folder, outside the importer's sandbox.
//
// Accepts Boxes of one dimension as observations and actions, float32 or float64, rounded to
// float32. Both files are hostile: a size is refused before memory is allocated for it, and a
// block of an episode takes at most a few MiB. Infos are ignored. Thread rule: one thread. Errors:
// as hdf5_file.h and minari_metadata.h, and kDataLoss where the two files contradict each other.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "data/d4rl/dataset_file_writer.h"
#include "data/hdf5/hdf5_file.h"
#include "data/minari/minari_metadata.h"
#include "proto/base/status.h"

namespace b4mrl {

// The folder with metadata.json of the Minari dataset in `path`, which is the dataset's folder or
// its subfolder "data"; no value if `path` is neither.
std::optional<std::string> FindMinariData(const std::string& path);

class MinariReader {
 public:
  // Opens the folder that FindMinariData found.
  static Result<MinariReader> Open(const std::string& data_folder);

  const MinariMetadata& metadata() const { return parsed_.metadata; }
  uint32_t observation_size() const { return parsed_.observation_size; }
  uint32_t action_size() const { return parsed_.action_size; }

  // Appends all rows to `writer`, episodes in the order of their numbers. terminations become
  // terminals, truncations become time-outs. The last row of an episode that has neither is marked
  // as timed out, because the rows of the next episode do not continue it; `unfinished` counts
  // these episodes. Where the metadata say last_is_unfinished, the last row is no time-out. Calls
  // `go_on` with the number of rows so far, every few thousand rows and within long episodes too;
  // an error of `go_on` ends the call.
  Status CopyTo(DatasetWriter& writer, uint64_t* unfinished,
                const std::function<Status(uint64_t rows)>& go_on) const;

 private:
  struct Block;
  struct Episode;
  MinariReader(Hdf5Reader file, ParsedMinariMetadata parsed);
  Result<Episode> OpenEpisode(uint64_t number) const;
  uint64_t EndEpisode(uint64_t number, Block* block) const;
  Result<Hdf5Column> OpenColumn(uint64_t episode, std::string_view name, uint64_t width) const;

  Hdf5Reader file_;
  ParsedMinariMetadata parsed_;
};

}  // namespace b4mrl
