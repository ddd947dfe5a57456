// Requests for many rows beside those of other clients.
#include "tests/server/datasets/dataset_worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("requests for many rows keep those of another client waiting for a part of one alone") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  pb::Request sample;
  sample.set_protocol_version(limits::kProtocolVersion);
  sample.set_deadline_ms(kPatienceMs);
  sample.mutable_sample()->set_fingerprint(
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint());
  sample.mutable_sample()->set_batches(5);
  sample.mutable_sample()->set_rows(limits::kMaxRowsPerBatch);
  constexpr int kLarge = 6, kSmall = 5;
  DealerSocket client = daemon.Connect();
  for (int id = 1; id <= kLarge; ++id) {
    sample.set_request_id(id);
    REQUIRE(client.Send({SerializeEnvelope(sample).value(), Frame()}).ok());
  }
  for (int i = 0; i < kSmall; ++i) {
    CHECK(daemon.Sample(sample.sample().fingerprint(), 0, i, 5).code() == StatusCode::kOk);
  }
  // A small one that waited for a whole large one, or for most of one, would have seen it answered.
  int answered = 0;
  while (client.TryReceive()) ++answered;
  CHECK(answered < kSmall - 1);
  for (; answered < kLarge; ++answered) CHECK(daemon.Receive(client).code() == StatusCode::kOk);
}

TEST_CASE("a request that takes much memory once parsed is refused, for it may have to wait") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  pb::Request list;
  list.mutable_list_datasets();
  for (int i = 0; i < 5'000; ++i) list.add_arrays();  // two bytes each
  REQUIRE(list.ByteSizeLong() < limits::kMaxEnvelopeBytes);
  const auto answer = daemon.Ask(list);
  CHECK(answer.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(answer.reply.status().message(), Catch::Contains("once parsed"));
}

}  // namespace
}  // namespace b4mrl
