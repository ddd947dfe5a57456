// Makes one dataset file by a recipe, as `b4mrl dataset make` does. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/datasets/dataset_recipes.h"
#include "algorithms/episodes/recorder.h"
#include "client/client.h"
#include "data/d4rl/action_log.h"
#include "data/d4rl/agent_file.h"
#include "data/d4rl/dataset_provenance.h"
#include "data/files/atomic_file.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

// What is to be recorded: a recipe of the table, or what the user asks for instead.
struct RecordingOrder {
  std::string name;  // of the dataset, "HalfCheetah/medium-v0"
  std::string environment;
  RecipeKind kind = RecipeKind::kUniform;
  std::vector<std::string> files;  // agents or an action log; none for uniform actions
  std::string simulator;           // perturbations as the user writes them: "hidden-low"
  uint64_t rows = 0;
  uint64_t seed = 0;    // ignored by replays, whose seed is the run's
  std::string command;  // the command line that makes the file again
  // What is done with a file that appears while the dataset is recorded.
  Existing existing = Existing::kKeep;

  // What ReadFiles finds in `files`, one for each of them.
  std::vector<std::string> sha256;
  std::vector<Agent> agents;     // empty for replays
  std::optional<ActionLog> log;  // of a replay
};

// Reads the order's files into it. Errors: those of the files. Asks no daemon.
Status ReadFiles(RecordingOrder& order);
// kInvalidArgument when an agent of the order is deterministic or has other sizes than the
// environment.
Status CheckAgents(const RecordingOrder& order, const EnvironmentSpec& environment);

struct Recording {
  RecordingSummary summary;
  DatasetProvenance provenance;
  std::optional<double> score;  // normalised mean return, if there is one
};

// The licence of all data that is made: Creative Commons Attribution 4.0.
inline constexpr char kDataLicence[] = "CC-BY-4.0";

// Writes the file at `path`, complete or not at all, by an order whose files have been read and
// whose environment is `environment`. Equal orders give equal bytes, whatever the daemon's numbers
// of workers and threads and the processor. Errors: those of CheckAgents, Collect and
// ReplayActions, and of writing.
Result<Recording> Record(const RecordingOrder& order, const EnvironmentSpec& environment,
                         const std::string& path, Client& client, bool quiet);

}  // namespace b4mrl
