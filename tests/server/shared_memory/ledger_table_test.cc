#include "server/shared_memory/ledger_table.h"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <set>

#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr int64_t kLeaseMs = 60'000;
// When a ledger was last used whose lease ran out, and when one that is even older.
int64_t LongAgo() { return MonotonicMs() - 2 * kLeaseMs; }
int64_t LongerAgo() { return MonotonicMs() - 3 * kLeaseMs; }

LedgerRecord& RecordOf(const SharedState& shared, uint64_t number) {
  return shared.ledger(static_cast<uint32_t>(number % limits::kMaxLedgers));
}

TEST_CASE("A ledger adds up what several processes count, and outlives them") {
  SharedState shared = Take(SharedState::Create(1, kLeaseMs));
  LedgerTable gateway(shared);
  const uint64_t number = Take(gateway.Open());
  CHECK(Take(gateway.Read(number)) == LedgerCounts());
  {
    SharedState mapped = Take(SharedState::Map(dup(shared.fd())));
    LedgerTable(mapped).Add(number, {.steps = 3, .episodes = 1});
  }
  LedgerTable(shared).Add(number, {.steps = 4, .query_rows = 5});
  LedgerTable(shared).Add(number, {.dataset_rows = 6});
  CHECK(Take(LedgerTable(shared).Read(number)) == LedgerCounts{7, 1, 5, 6});
}

TEST_CASE("A number that no ledger has is unknown to a reader and counts nowhere") {
  SharedState shared = Take(SharedState::Create(1, kLeaseMs));
  LedgerTable table(shared);
  const uint64_t number = Take(table.Open());
  // Of the ledger's own record, of a free record, and of none.
  for (const uint64_t wrong : {number + limits::kMaxLedgers, number + 1, uint64_t{0}, UINT64_MAX}) {
    table.Add(wrong, {1, 1, 1, 1});
    const Status status = table.Read(wrong).status();
    CHECK(status.code() == StatusCode::kUnknownName);
    CHECK_THAT(status.message(), Catch::Contains(std::to_string(wrong)));
  }
  CHECK(Take(table.Read(number)) == LedgerCounts());
}

TEST_CASE("Numbers differ in their random bits, are signed integers and never 0") {
  SharedState shared = Take(SharedState::Create(1, kLeaseMs));
  LedgerTable table(shared);
  std::set<uint64_t> drawn;
  for (int i = 0; i < 100; ++i) {
    const uint64_t number = Take(table.Open());
    CHECK(number < uint64_t{1} << 63);
    drawn.insert(number / limits::kMaxLedgers);
    RecordOf(shared, number).number = 0;  // the next ledger gets the same record
  }
  CHECK(drawn.size() == 100);
  CHECK_FALSE(drawn.contains(0));
}

TEST_CASE("A full table refuses, until a ledger's lease has run out: then the oldest makes room") {
  SharedState shared = Take(SharedState::Create(1, kLeaseMs));
  LedgerTable table(shared);
  std::vector<uint64_t> numbers;
  for (uint32_t i = 0; i < limits::kMaxLedgers; ++i) numbers.push_back(Take(table.Open()));
  const Status full = table.Open().status();
  CHECK(full.code() == StatusCode::kLimitExceeded);
  CHECK_THAT(full.message(), Catch::Contains(std::to_string(limits::kMaxLedgers)));

  table.Add(numbers[7], {1, 2, 3, 4});
  RecordOf(shared, numbers[5]).last_use_ms = LongAgo();
  RecordOf(shared, numbers[7]).last_use_ms = LongerAgo();
  const uint64_t added = Take(table.Open());
  CHECK(added % limits::kMaxLedgers == numbers[7] % limits::kMaxLedgers);
  CHECK(Take(table.Read(added)) == LedgerCounts());
  CHECK(table.Read(numbers[7]).status().code() == StatusCode::kUnknownName);
  CHECK(table.Read(numbers[5]).ok());  // which renews its lease
  CHECK(table.Open().status().code() == StatusCode::kLimitExceeded);
}

TEST_CASE("However long the lease is, a ledger that is unused for an hour makes room") {
  SharedState shared = Take(SharedState::Create(1, 30 * 24 * kLedgerIdleMs));
  LedgerTable table(shared);
  std::vector<uint64_t> numbers;
  for (uint32_t i = 0; i < limits::kMaxLedgers; ++i) numbers.push_back(Take(table.Open()));
  CHECK(table.Open().status().code() == StatusCode::kLimitExceeded);
  RecordOf(shared, numbers[5]).last_use_ms = MonotonicMs() - kLedgerIdleMs - 1000;
  CHECK(Take(table.Open()) % limits::kMaxLedgers == numbers[5] % limits::kMaxLedgers);
}

TEST_CASE("Reading a ledger and adding to it renew its lease") {
  SharedState shared = Take(SharedState::Create(1, kLeaseMs));
  LedgerTable table(shared);
  const uint64_t number = Take(table.Open());
  const int64_t before = LongAgo();
  RecordOf(shared, number).last_use_ms = before;
  SECTION("reading") { RequireOk(table.Read(number).status()); }
  SECTION("adding") { table.Add(number, {.steps = 1}); }
  CHECK(RecordOf(shared, number).last_use_ms > before + kLeaseMs);
}

}  // namespace
}  // namespace b4mrl
