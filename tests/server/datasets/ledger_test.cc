// What the dataset worker counts in the ledger of a request.
#include <catch2/catch.hpp>
#include <string>

#include "server/shared_memory/ledger_table.h"
#include "tests/results.h"
#include "tests/server/datasets/dataset_worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("rows are counted in the ledger that their request names, when they were served") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  LedgerTable ledgers(daemon.shared());
  const uint64_t ledger = Take(ledgers.Open());
  const std::string fingerprint =
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  pb::Request sample;
  sample.mutable_sample()->set_fingerprint(fingerprint);
  sample.mutable_sample()->set_batches(3);
  sample.mutable_sample()->set_rows(20);
  sample.mutable_sample()->set_ledger(ledger);
  pb::Request read;
  read.mutable_read()->set_fingerprint(fingerprint);
  read.mutable_read()->set_first_row(1490);  // of 1500
  read.mutable_read()->set_rows(100);
  read.mutable_read()->set_ledger(ledger);
  REQUIRE(daemon.Ask(sample).code() == StatusCode::kOk);
  CHECK(Take(ledgers.Read(ledger)) == LedgerCounts{.dataset_rows = 60});
  REQUIRE(daemon.Ask(read).code() == StatusCode::kOk);
  CHECK(Take(ledgers.Read(ledger)) == LedgerCounts{.dataset_rows = 70});

  SECTION("what is refused was not served") {
    sample.mutable_sample()->set_rows(0);
    CHECK(daemon.Ask(sample).code() == StatusCode::kInvalidArgument);
  }
  SECTION("an unknown ledger changes nothing about the reply") {
    sample.mutable_sample()->set_ledger(ledger + limits::kMaxLedgers);
    CHECK(daemon.Ask(sample).code() == StatusCode::kOk);
    sample.mutable_sample()->set_ledger(UINT64_MAX);
    CHECK(daemon.Ask(sample).code() == StatusCode::kOk);
  }
  CHECK(Take(ledgers.Read(ledger)) == LedgerCounts{.dataset_rows = 70});
}

}  // namespace
}  // namespace b4mrl
