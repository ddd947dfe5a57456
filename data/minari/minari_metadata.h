// data/metadata.json of a Minari dataset: the spaces, the environment, reference scores, and, in an
// entry "b4mrl" that Minari ignores, where the rows come from (dataset_provenance.h).
//
// Value types and pure functions; any thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "data/d4rl/dataset_provenance.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

inline constexpr char kMinariMetadataFile[] = "metadata.json";
inline constexpr char kMinariDataFile[] = "main_data.hdf5";
inline constexpr size_t kMaxMinariMetadataBytes = 16 << 20;

struct MinariMetadata {
  std::string id;
  uint64_t episodes = 0;
  uint64_t rows = 0;
  std::string algorithm;    // of the behaviour policy; "" if it is not known
  std::string description;  // in words
  // "HalfCheetah-v5": the environment's id in Gymnasium's registry; "" if the file does not say.
  std::string gymnasium_id;
  std::string gymnasium_kwargs;   // the environment's arguments as ASCII JSON; "" for none
  DatasetProvenance provenance;   // empty in files of others
  bool d4rl_transitions = false;  // whether the rows follow D4RL's rule (columns/episodes.h)
  // Whether the last row is marked as truncated only because the rows end there.
  bool last_is_unfinished = false;
};

// What a file that is written says beyond MinariMetadata.
struct MinariDescription {
  MinariMetadata metadata;
  SpaceSpec observation, action;
  std::optional<double> reference_min, reference_max;  // returns with scores 0 and 1
  std::string author;                                  // "" if it is not known
  std::map<std::string, std::string> source;           // further facts for the entry "b4mrl"
};

// The text of metadata.json. `data_bytes` is the size of main_data.hdf5. The environment is
// metadata.provenance's, with its simulator, as the Python client b4mrl registers it; "" leaves it
// out.
std::string MinariMetadataText(const MinariDescription& description, uint64_t data_bytes);

// Reads the text of a hostile metadata.json. The sizes are those of its spaces, which must be Boxes
// of one dimension and float32 or float64. kInvalidArgument with the entry, its value and what is
// allowed; kDataLoss if the text is not JSON.
struct ParsedMinariMetadata {
  MinariMetadata metadata;
  uint32_t observation_size = 0;
  uint32_t action_size = 0;
};
Result<ParsedMinariMetadata> ParseMinariMetadata(std::string_view text);

}  // namespace b4mrl
