// Requests for datasets that come again while the first copy still waits.
#include "tests/server/datasets/dataset_worker_fixture.h"

namespace b4mrl {
namespace {

pb::Request OpenOther() {
  pb::Request open;
  open.set_protocol_version(limits::kProtocolVersion);
  open.set_request_id(7);
  open.set_deadline_ms(limits::kMaxDeadlineMs);
  open.mutable_open_dataset()->set_dataset("HalfCheetah/other");
  return open;
}

void Send(DealerSocket& socket, const pb::Request& request) {
  REQUIRE(socket.Send({SerializeEnvelope(request).value(), Frame()}).ok());
}

TEST_CASE("copies of a request that waits take no further place and are answered once") {
  DataFolder files;
  REQUIRE(WriteExample(files.folder.File("HalfCheetah/other.h5"), files.data).ok());
  Daemon daemon(files.folder.path(), files.EndlessImporter());
  DealerSocket client = daemon.Connect();
  pb::Request open = OpenOther();
  constexpr int kCopies = 200;  // 64 requests of one connection may wait
  for (int i = 0; i < kCopies; ++i) Send(client, open);
  open.set_deadline_ms(1);
  Send(client, open);
  // The deadline of the last copy holds for all of them.
  const Daemon::Answer late = daemon.Receive(client);
  CHECK(late.reply.request_id() == 7);
  CHECK(late.code() == StatusCode::kDeadlineExceeded);
  // Whatever else the worker had to say to the client, it would have said before this.
  pb::Request bad = OpenOther();
  bad.set_request_id(8);
  bad.mutable_open_dataset()->set_transition_rule("none");
  Send(client, bad);
  const Daemon::Answer next = daemon.Receive(client);
  CHECK(next.reply.request_id() == 8);
  CHECK(next.code() == StatusCode::kUnknownName);
}

TEST_CASE("an id that is used for another dataset, or by another client, is another request") {
  DataFolder files;
  REQUIRE(WriteExample(files.folder.File("HalfCheetah/other.h5"), files.data).ok());
  Daemon daemon(files.folder.path(), files.ImporterThatHangsOn("other"));
  DealerSocket first = daemon.Connect(), second = daemon.Connect();
  Send(first, OpenOther());
  pb::Request medium = OpenOther(), brief = OpenOther();
  medium.mutable_open_dataset()->set_dataset("HalfCheetah/medium");
  Send(first, medium);
  CHECK(daemon.Receive(first).code() == StatusCode::kOk);
  brief.set_deadline_ms(1);
  Send(second, brief);
  CHECK(daemon.Receive(second).code() == StatusCode::kDeadlineExceeded);
  CHECK_FALSE(first.TryReceive().has_value());
}

}  // namespace
}  // namespace b4mrl
