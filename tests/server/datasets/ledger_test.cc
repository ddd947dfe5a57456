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

TEST_CASE("rows are neither served nor counted when their turn comes after the deadline") {
  constexpr uint64_t kLarge = 16;  // requests of 22 MB each, which take 100 ms or more together
  DataFolder files;
  Daemon daemon(files.folder.path());
  LedgerTable ledgers(daemon.shared());
  const uint64_t ledger = Take(ledgers.Open());
  pb::Request sample;
  sample.set_protocol_version(limits::kProtocolVersion);
  sample.set_deadline_ms(kPatienceMs);
  sample.mutable_sample()->set_fingerprint(
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint());
  sample.mutable_sample()->set_batches(2);
  sample.mutable_sample()->set_rows(limits::kMaxRowsPerBatch);
  // All requests are there when the worker starts, which has mapped nothing then. Mapping takes
  // 2 ms; if it takes more than the last one's deadline, that one ends by it in the same way.
  daemon.Stop();
  DealerSocket client = daemon.Connect();
  for (uint64_t id = 1; id <= kLarge + 1; ++id) {
    sample.set_request_id(id);
    if (id > kLarge) sample.set_deadline_ms(20);
    if (id > kLarge) sample.mutable_sample()->set_ledger(ledger);
    REQUIRE(client.Send({SerializeEnvelope(sample).value(), Frame()}).ok());
  }
  daemon.Start();
  for (uint64_t i = 0; i <= kLarge; ++i) {
    const auto answer = daemon.Receive(client);
    const bool is_late = answer.reply.request_id() > kLarge;
    CHECK(answer.code() == (is_late ? StatusCode::kDeadlineExceeded : StatusCode::kOk));
  }
  CHECK(Take(ledgers.Read(ledger)) == LedgerCounts{});
}

}  // namespace
}  // namespace b4mrl
