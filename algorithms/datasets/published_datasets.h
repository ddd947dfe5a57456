// The figures of the published datasets, data/datasets.toml: what a dataset that is made by its
// recipe must come to. The file has a table for each dataset:
//
//   ["HalfCheetah/medium-v0"]
//   recipe = "episodes of one behaviour policy"
//   policies_sha256 = ["<SHA-256 of the agent's file>"]
//   seeds = ["0"]
//   rows = 1_000_000
//   episodes = 1_000                 (that ended)
//   columns_sha256 = "<data/columns/columns_hash.h>"
//   mean_return = 4664.5
//   std_return = 71.2
//   normalised_score = 39.8          (not for Highway, which has no reference returns)
//   engine = "MuJoCo 2.2.2"
//   license = "CC-BY-4.0"
//
// Value types; no thread rule. Errors: kIoError, kInvalidArgument with the file's line or entry.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/datasets/dataset_recording.h"
#include "proto/base/status.h"

namespace b4mrl {

struct PublishedDataset {
  std::string recipe;
  std::vector<std::string> policies_sha256;
  std::vector<std::string> seeds;
  uint64_t rows = 0;
  std::string columns_sha256;
  double mean_return = 0;
  double std_return = 0;
  std::optional<double> normalised_score;
  std::string engine;
  std::string license;
};

using PublishedDatasets = std::map<std::string, PublishedDataset, std::less<>>;  // by full name

Result<PublishedDatasets> ReadPublishedDatasets(const std::string& path);
// The file that comes with the program.
Result<PublishedDatasets> ReadPublishedDatasets();

// The figures published under a dataset's full name, if its rows, by their hash, are others; null
// if they are these, or if none are published.
const PublishedDataset* PublishedOtherwise(const PublishedDatasets& published,
                                           std::string_view name, std::string_view columns_sha256);

// What differs between a recording and the published dataset, one line each; none: its rows are
// those that were published.
std::vector<std::string> Differences(const Recording& made, const PublishedDataset& published);

}  // namespace b4mrl
