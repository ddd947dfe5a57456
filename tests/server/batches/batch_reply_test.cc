// Replies that are filled piece by piece.
#include "server/batches/batch_reply.h"

#include <catch2/catch.hpp>
#include <string>

#include "proto/base/limits.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

// The payload when a reply is filled at once, or with an interruption wherever there can be one.
template <typename Request>
std::string Payload(const Request& request, const std::shared_ptr<const Dataset>& dataset,
                    bool with_interruptions) {
  auto reply = BatchReply::To(request, dataset);
  REQUIRE(reply.ok());
  const size_t bytes = reply->payload_bytes();
  int interruptions = 0;
  while (!reply->Fill([&]() -> size_t { return with_interruptions ? 0 : 7; })) {
    REQUIRE(with_interruptions);
    ++interruptions;
    BatchReply moved = std::move(*reply);  // as in a queue
    *reply = std::move(moved);
  }
  CHECK((interruptions > 0) == with_interruptions);
  REQUIRE(reply->payload.size() == bytes);
  return std::string(reply->payload.view());
}

TEST_CASE("a reply has the same bytes wherever its filling is interrupted") {
  const StoreFixture files;
  const std::shared_ptr<const Dataset> dataset = files.OpenMade("").value().dataset;
  pb::ReadRequest read;
  read.set_rows(limits::kMaxRowsPerBatch);
  read.set_first_row(3);
  CHECK(Payload(read, dataset, true) == Payload(read, dataset, false));
  pb::SampleRequest sample;
  sample.set_seed(5);
  sample.set_with_indices(true);
  // Few and many batches that are drawn together, and batches that are drawn alone.
  for (const auto& [rows, batches] : {std::pair{40u, 1u}, {1000u, 20u}, {40000u, 3u}}) {
    sample.set_rows(rows);
    sample.set_batches(batches);
    CHECK(Payload(sample, dataset, true) == Payload(sample, dataset, false));
  }
}

TEST_CASE("a sample of several batches has the rows of its batches") {
  const StoreFixture files;
  const std::shared_ptr<const Dataset> dataset = files.OpenMade("").value().dataset;
  const auto indices = [&](uint64_t first, uint32_t rows, uint32_t batches) {
    pb::SampleRequest sample;
    sample.set_first_batch(first);
    sample.set_rows(rows);
    sample.set_batches(batches);
    sample.set_with_indices(true);
    auto reply = BatchReply::To(sample, dataset);
    REQUIRE(reply.ok());
    REQUIRE(reply->Fill([] { return 1000; }));
    const auto& table = reply->envelope.arrays();
    const auto values = ArrayAt<uint64_t>(reply->payload, table.rbegin()->offset(), rows * batches);
    return std::vector<uint64_t>(values.begin(), values.end());
  };
  std::vector<uint64_t> one_by_one;
  for (uint64_t batch = 7; batch < 27; ++batch) {
    const auto more = indices(batch, 1000, 1);
    one_by_one.insert(one_by_one.end(), more.begin(), more.end());
  }
  CHECK(indices(7, 1000, 20) == one_by_one);
}

}  // namespace
}  // namespace b4mrl
