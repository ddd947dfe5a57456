// The actions of a training run's first transitions, by which they can be stepped again: the files
// of data/replays, which data/replays/write_replay.py writes.
//
//   actions (N, act) f32     in [-1, 1], before they are scaled to the environment's bounds
//   metadata/environment, simulator, autoreset, command, replay_sha256    text
//   metadata/seed, warm_up, lanes, transitions                            numbers
//
// Value type; no thread rule. Errors: as hdf5_file.h, and kInvalidArgument for a run of more than
// one lane, for another autoreset mode than same_step and for sizes that contradict each other.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

struct ActionLog {
  std::string environment;
  std::string simulator;  // perturbations as text; "" for the true environment
  std::string command;    // the command line of the run
  uint64_t seed = 0;      // of the run
  uint64_t rows = 0;
  uint32_t action_size = 0;
  std::vector<float> actions;  // rows x action size
  // SHA-256 of the first bytes of the run's replay.bin: its header and `rows` records.
  std::string replay_sha256;
};

Result<ActionLog> ReadActionLog(const std::string& path);

}  // namespace b4mrl
