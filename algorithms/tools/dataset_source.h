// The dataset that `b4mrl dataset export` and `b4mrl dataset info` read: its name, its corruptions,
// and the daemon that serves it, whose sandboxed importer reads the untrusted file. One thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "algorithms/tools/command.h"

namespace b4mrl {

// Members are bound to a command's options by AddTo, so they must outlive the options.
struct DatasetSource {
  std::string name, corruption, transitions = "stored";
  uint64_t corruption_seed = 0;
  bool quiet = false;
  DaemonOptions daemon;

  // Adds the dataset's name, --corruption, --corruption-seed, --transitions, --quiet and the
  // daemon's options.
  void AddTo(CLI::App& app);
  // Opens the dataset with its corruptions and calls `use`.
  using Use = std::function<std::optional<Failure>(Client&, RemoteDataset&)>;
  std::optional<Failure> Open(const Use& use) const;
};

// Calls `use` for all rows of a dataset in order, in parts. kDataLoss if the daemon has fewer rows
// than it said.
Status ForEachRows(RemoteDataset& dataset,
                   const std::function<Status(const TransitionRows& rows)>& use);

struct OddRows {
  uint64_t nonfinite = 0;  // hold a NaN or an infinity: `b4mrl train` refuses a dataset with such
  uint64_t outside = 0;    // whose action is not in its space
};
// Reads all rows. `action` is empty where the actions' space is not known.
Result<OddRows> CountOddRows(RemoteDataset& dataset, const SpaceSpec& action);

}  // namespace b4mrl
