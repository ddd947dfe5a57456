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

}  // namespace b4mrl
