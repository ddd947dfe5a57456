// A run as its result tells of it: what it scored, after how many updates, and where it came from.
// Value types; any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/datasets/published_datasets.h"
#include "benchmarks/records/curve.h"
#include "proto/base/status.h"

namespace b4mrl {

struct Series {
  // "hymopo", or the name of a user's own learner; "mine (self-scored)", "td3-bc (user)".
  std::string algorithm;
  std::string recipe;  // "" for algorithms with a single one
  // It did not learn from the published rows of the benchmark's dataset, which its recipe says.
  bool has_other_data = false;
  auto operator<=>(const Series&) const = default;
};

// A run as its result tells of it, at its last evaluation that counts (see ReadingLimit).
struct ScoredRun {
  std::string id, file;  // `file` without its folder
  std::string cell_key;  // equal for the runs of one cell
  Series series;
  std::string simulator, dataset;  // "": none; the dataset as benchmarks name it
  std::string dataset_file;        // with its version: "HalfCheetah/medium-v0"
  uint64_t rows = 0;               // of that
  std::vector<std::string> benchmarks;
  uint64_t seed = 0;
  double score = 0;        // normalised; the return where the task has no reference returns
  bool is_return = false;  // `score` is a return
  uint64_t updates = 0;
  bool ended = false;     // its training is over, or has come to all that counts
  bool diverged = false;  // its training is over because it diverged, before all that counts
  Fifths fifths;          // of the curve
  std::optional<uint64_t> learns_until;   // see LearnsUntil in records/result_file.h
  Curve curve;                            // until then
  bool fills_a_cell = false;              // of a benchmark that the table knows
  std::map<std::string, double> further;  // "full", "served": the agent's scores seen otherwise
  // Of the whole run, of which a part may count here.
  double core_hours = 0;
  std::optional<uint64_t> simulator_steps, query_rows, dataset_rows;
  bool is_part = false;
  std::string budget, precision, source, version, commit, processor, kernel, columns_sha256;

  // Whether it learned from a file of D4RL's.
  bool HasD4rlsData() const;
  // Whether it learned from other rows than those published as its dataset.
  bool HasOtherRows() const { return series.has_other_data && !HasD4rlsData(); }
  // The updates of its last evaluation within so many; nothing if it had none.
  std::optional<uint64_t> LastEvaluation(uint64_t end) const;
  // The run as it was at that evaluation.
  std::optional<ScoredRun> At(uint64_t end) const;
};

// Until which update a run counts; nothing: all of it.
using ReadingLimit = std::function<std::optional<uint64_t>(const ScoredRun& run)>;

// The run of a result. Runs on D4RL's files, and on other rows than those published, are series of
// their own, "TD3-BC (D4RL's data)", and so are scores that their author measured, and those of a
// user's learner that is called like an algorithm of the project. The error says why the JSON is
// none that counts.
Result<ScoredRun> ReadScoredRun(const nlohmann::ordered_json& json, const ReadingLimit& limit,
                                const PublishedDatasets& published);

// "TD3", "HyMOPO"; a user's own name as it is.
std::string DisplayName(const std::string& algorithm);
// "HyMOPO (short)".
std::string DisplayName(const Series& series);
// The place of an algorithm in the field's order; users' own come last.
size_t OrderOf(const std::string& algorithm);

}  // namespace b4mrl
