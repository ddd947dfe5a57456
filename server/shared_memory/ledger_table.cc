#include "server/shared_memory/ledger_table.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// A ledger's number is its record's index plus a random multiple of limits::kMaxLedgers, of at
// most 63 bits, so that it is a signed integer everywhere.
Result<uint64_t> DrawNumber(uint64_t index) {
  constexpr uint64_t kMultiples = (uint64_t{1} << 63) / limits::kMaxLedgers;
  uint64_t random = 0;
  if (getrandom(&random, sizeof(random), 0) != sizeof(random)) {
    return Status(StatusCode::kInternal, "the system gives no random numbers");
  }
  return (1 + random % (kMultiples - 1)) * limits::kMaxLedgers + index;
}

void AddTo(std::atomic<uint64_t>& total, uint64_t count) {
  if (count > 0) total.fetch_add(count, std::memory_order_relaxed);
}

// How long a ledger is kept though nobody uses it and others want its room.
int64_t KeptMs(const SharedState& shared) {
  return std::min(shared.header().lease_ms, kLedgerIdleMs);
}

}  // namespace

LedgerRecord* LedgerTable::Find(uint64_t number) const {
  LedgerRecord& record = shared_.ledger(static_cast<uint32_t>(number % limits::kMaxLedgers));
  const bool is_its = number != 0 && record.number.load(std::memory_order_acquire) == number;
  return is_its ? &record : nullptr;
}

LedgerRecord* LedgerTable::FindRoom() const {
  LedgerRecord* oldest = &shared_.ledger(0);
  for (uint32_t index = 0; index < limits::kMaxLedgers; ++index) {
    LedgerRecord& record = shared_.ledger(index);
    if (record.number == 0) return &record;
    if (record.last_use_ms < oldest->last_use_ms) oldest = &record;
  }
  const bool has_ended = MonotonicMs() - oldest->last_use_ms > KeptMs(shared_);
  return has_ended ? oldest : nullptr;
}

Result<uint64_t> LedgerTable::Open() {
  LedgerRecord* record = FindRoom();
  if (record == nullptr) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} ledgers are in use, at most {}; one that is neither read nor "
                              "added to for {} s makes room",
                              limits::kMaxLedgers, limits::kMaxLedgers, KeptMs(shared_) / 1000));
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t number,
                         DrawNumber(static_cast<uint64_t>(record - &shared_.ledger(0))));
  record->number.store(0);
  for (std::atomic<uint64_t>* total :
       {&record->steps, &record->episodes, &record->query_rows, &record->dataset_rows}) {
    total->store(0);
  }
  record->last_use_ms.store(MonotonicMs());
  record->number.store(number, std::memory_order_release);
  return number;
}

Result<LedgerCounts> LedgerTable::Read(uint64_t number) {
  LedgerRecord* record = Find(number);
  if (record == nullptr) {
    return Status(StatusCode::kUnknownName,
                  fmt::format("unknown ledger {}: it was never opened, or it ended", number));
  }
  record->last_use_ms.store(MonotonicMs(), std::memory_order_relaxed);
  return LedgerCounts{record->steps, record->episodes, record->query_rows, record->dataset_rows};
}

void LedgerTable::Add(uint64_t number, const LedgerCounts& used) {
  LedgerRecord* record = Find(number);
  if (record == nullptr) return;
  AddTo(record->steps, used.steps);
  AddTo(record->episodes, used.episodes);
  AddTo(record->query_rows, used.query_rows);
  AddTo(record->dataset_rows, used.dataset_rows);
  record->last_use_ms.store(MonotonicMs(), std::memory_order_relaxed);
}

}  // namespace b4mrl
