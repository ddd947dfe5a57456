// The datasets that a plan's runs need: what is there of them, and jobs that make the others.
// Thread rule: one thread.
//
//   DIR/datasets/<name>.claim   held while a dataset is made
//   DIR/datasets/<name>.log     the messages of its making
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "benchmarks/jobs/job.h"
#include "benchmarks/plan/plan.h"
#include "benchmarks/records/result_file.h"
#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetPlace {
  std::string folder;                     // DIR
  std::string data_folder;                // of the daemon, perhaps on another machine
  std::vector<std::string> daemon_words;  // options of a command that choose its daemon
  bool makes_own_rows = false;            // as many as its run has, not the recipe's
};

class DatasetJobs {
 public:
  // `client`, which outlives the object, is connected to the daemon of the data.
  DatasetJobs(Client& client, DatasetPlace place) : client_(client), place_(std::move(place)) {}

  // None if the data folder does not have it.
  Result<std::optional<UsedDataset>> Find(const std::string& full_name) const;
  // The same with its rows counted, for which it is opened if they are not. A file that was made
  // again is not counted until somebody opens it.
  Result<std::optional<UsedDataset>> FindCounted(const std::string& full_name) const;
  // The dataset of a run that has learned from it; nothing of a run without one.
  // kFailedPrecondition if it is gone.
  Result<std::optional<UsedDataset>> LearnedFrom(const PlannedRun& run) const;
  // Sets rows_at_hand of the runs, as far as somebody has counted the rows or, if `counts` says so,
  // they can be counted now.
  void NoteRowsAtHand(bool counts, std::vector<PlannedRun>* plan) const;
  // Why a run must not train on it: its rows are not those for which the run was planned. "": they
  // are, or nobody has counted them yet.
  std::string Refusal(const PlannedRun& run, const UsedDataset& dataset) const;
  // The refusals of all runs of a plan, each once; of data whose rows somebody has counted.
  Result<std::set<std::string>> Refusals(const std::vector<PlannedRun>& plan) const;
  // Why it could not be made, though that was tried kMostAttempts times.
  std::optional<std::string> Failure(const std::string& full_name) const;

  // A job that makes the run's dataset; nothing while another process does.
  Result<std::optional<Job>> Begin(const PlannedRun& run);
  // Takes note of a job that has ended; returns what to say of one that failed.
  std::optional<std::string> Finish(const std::string& full_name, int exit_code);

 private:
  Result<std::vector<UsedDataset>> ListUsed() const;
  // What to do about rows that a run must not train on.
  std::string WayOut(const PlannedRun& run) const;
  // Whether a process without this folder's claim is making it.
  bool IsMadeElsewhere(const std::string& full_name) const;
  std::string CouldNotBeMade(const std::string& full_name) const;

  Client& client_;
  DatasetPlace place_;
  std::map<std::string, int> attempts_;  // that failed, by full name
};

}  // namespace b4mrl
