// Ledgers: what learners have used of the daemon, counted where it is served.
//
// A client opens a ledger at the gateway and names its number when it opens sessions and asks for
// rows of datasets. Whoever serves them adds to the ledger's totals in shared memory, so the totals
// outlive workers and gateway. What a process had served but not yet added when it was killed is
// lost, at most the requests that it had under way.
//
// A ledger ends when all records are in use and it has been neither read nor added to for an hour,
// or for the daemon's lease if that is shorter: the record is then another ledger's. Counting never
// fails: what names a ledger that has ended is counted nowhere.
//
// Thread rule: Open, the gateway's main thread; Read and Add, any thread of any process.
#pragma once

#include <cstdint>

#include "proto/base/ledger_counts.h"
#include "proto/base/status.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

// How long a ledger is kept though nobody uses it, where no other record is left and the lease is
// longer: private daemons have one of days, and programs open a ledger for each benchmark.
inline constexpr int64_t kLedgerIdleMs = 3'600'000;

class LedgerTable {
 public:
  explicit LedgerTable(SharedState& shared) : shared_(shared) {}

  // The number of a new ledger, never 0. Most of its bits are random, so that no client can guess
  // another's. kLimitExceeded when limits::kMaxLedgers are in use.
  Result<uint64_t> Open();
  // Counts as a use. kUnknownName if no ledger has this number.
  Result<LedgerCounts> Read(uint64_t number);
  // Adds to the totals of the ledger with this number, if there is one. A record that changes
  // hands at this very moment may take the counts to its next ledger.
  void Add(uint64_t number, const LedgerCounts& used);

 private:
  // The record of the ledger with this number; null if there is none.
  LedgerRecord* Find(uint64_t number) const;
  // A free record, else that of the ledger that has been unused for longest, if for long enough;
  // null: none.
  LedgerRecord* FindRoom() const;

  SharedState& shared_;
};

}  // namespace b4mrl
