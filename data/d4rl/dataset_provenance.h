// Where the rows of a dataset file come from, as the file itself says.
//
// A file that B4MRL writes has, beside its rows and its behaviour policy,
//   metadata/license                  licence of the data, as an SPDX identifier
//   metadata/recording/name           full name of the dataset, with its version
//   metadata/recording/environment    the task in which the rows were recorded
//   metadata/recording/simulator      perturbations of that task while recording; "" for none
//   metadata/recording/hidden         hidden observation dimensions, as text: "9,16"; "" for none
//   metadata/recording/history        observations that the behaviour policy saw at a time
//   metadata/recording/recipe         how the rows were made, in words
//   metadata/recording/policies       behaviour policy of each part, in words, joined by ";"
//   metadata/recording/policies_sha256, seeds, rows   of each part, joined by ","
//   metadata/recording/engine, program, command       what made the file
// Files of others have none of these; the environment may then stand in metadata/environment.
// Everything but the history, a whole number, is text of at most kMaxProvenanceText bytes.
//
// Value types; no thread rule. Errors: as hdf5_file.h, and kInvalidArgument for an entry outside
// its range.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "data/hdf5/hdf5_file.h"
#include "proto/base/status.h"

namespace b4mrl {

inline constexpr size_t kMaxProvenanceText = 2048;  // bytes of one entry
inline constexpr size_t kMaxRecordedParts = 16;

// Consecutive rows of a file that one behaviour policy recorded with one seed. Parts follow each
// other in the order of the rows.
struct RecordedPart {
  std::string policy;         // in words, without ';': "uniform random actions"
  std::string policy_sha256;  // SHA-256 of the agent's file or of the action log; "" if neither
  uint64_t seed = 0;          // seed of the episodes' starts and of the actions
  uint64_t rows = 0;
  bool operator==(const RecordedPart&) const = default;
};

struct DatasetProvenance {
  std::string name;         // "HalfCheetah/medium-v0"
  std::string environment;  // "HalfCheetah"; "" if the file does not say
  std::string simulator;    // "hidden=9+16,obs-noise=0.05"; "" for the true environment
  // Observation dimensions that the behaviour policy could not see, which are 0 in the rows.
  // Ascending.
  std::vector<uint32_t> hidden_dimensions;
  uint32_t history_length = 1;
  std::string recipe;
  std::vector<RecordedPart> parts;
  std::string engine;   // what computed the dynamics: "MuJoCo 3.3.2"
  std::string program;  // "b4mrl 0.1.0"
  std::string command;  // command line with which the file is made again
  std::string license;  // "CC-BY-4.0"
  bool operator==(const DatasetProvenance&) const = default;

  // OK if every entry is within its range.
  Status Validate() const;
  // OK if the hidden dimensions are some of an observation with so many.
  Status CheckHidden(uint32_t observation_size) const;
};

// The entries that are one text each, by their names under metadata/recording.
struct ProvenanceText {
  std::string_view name;
  std::string DatasetProvenance::*text;
};
inline constexpr ProvenanceText kProvenanceTexts[] = {
    {"name", &DatasetProvenance::name},           {"environment", &DatasetProvenance::environment},
    {"simulator", &DatasetProvenance::simulator}, {"recipe", &DatasetProvenance::recipe},
    {"engine", &DatasetProvenance::engine},       {"program", &DatasetProvenance::program},
    {"command", &DatasetProvenance::command},
};

// Writes all entries; each may stand in a file once.
Status WriteDatasetProvenance(Hdf5Writer& file, const DatasetProvenance& provenance);
// Reads the entries that are there; those that are not keep their defaults.
Result<DatasetProvenance> ReadDatasetProvenance(const Hdf5Reader& file);

}  // namespace b4mrl
