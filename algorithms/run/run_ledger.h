// What a run has used, counted by its daemon: the learner's steps, queries and dataset rows, and
// the episodes of its evaluations on the true environment.
//
// The learner and the evaluations have a ledger each (Client::OpenLedger). The totals of a resumed
// run go on from its checkpoint. What its learner repeats while it is loaded, such as the rollouts
// that fill MOPO's buffer again, is not counted a second time. So the totals of a resumed run are
// those of an undisturbed one, except for what a learner asks for ahead of its use: rows of a
// dataset, and the queries of a rollout under way (rollout-lag 1).
//
// Counting never fails a run. While the daemon does not answer, the last totals hold. If it has
// lost a ledger, a new one goes on from them; sessions that were opened before still name the lost
// one and are counted nowhere. Thread rule: the client's.
#pragma once

#include <cstdint>
#include <string_view>

#include "algorithms/base/checkpoint.h"
#include "client/client.h"
#include "proto/base/ledger_counts.h"

namespace b4mrl {

struct RunUse {
  uint64_t simulator_steps = 0;      // of the learner, warm-up included
  uint64_t query_rows = 0;           // of the learner
  uint64_t dataset_rows = 0;         // received by the learner
  uint64_t evaluation_episodes = 0;  // on the true environment
};

// The names under which logs, result.json and checkpoints hold these numbers.
struct RunUseEntry {
  std::string_view name;
  uint64_t RunUse::*value;
};
inline constexpr RunUseEntry kRunUseEntries[] = {
    {"simulator_steps", &RunUse::simulator_steps},
    {"query_rows", &RunUse::query_rows},
    {"dataset_rows", &RunUse::dataset_rows},
    {"evaluation_episodes", &RunUse::evaluation_episodes},
};

class RunLedger {
 public:
  // Opens the two ledgers. `client` outlives the object.
  explicit RunLedger(Client& client);

  // Numbers of the ledgers for options of sessions and datasets; 0 while there is none. They change
  // only in Refresh and Load.
  uint64_t learner() const { return learner_.number; }
  uint64_t evaluations() const { return evaluations_.number; }

  // Asks the daemon for what was used since the last call.
  void Refresh();
  // The totals at the last Refresh.
  RunUse use() const;

  void Save(CheckpointWriter& writer) const;
  // To be called after the learner was loaded. Checkpoints of older program versions have no
  // totals, which then begin at 0.
  void Load(CheckpointReader& reader);

 private:
  struct Account {
    uint64_t number = 0;
    LedgerCounts read;   // the ledger's totals when it was last read
    LedgerCounts total;  // of the run
  };
  void Refresh(Account* account);

  Client* client_;
  Account learner_;
  Account evaluations_;
};

}  // namespace b4mrl
