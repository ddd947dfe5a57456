// The reply to ServerStatus, from shared memory that the test fills.
#include "server/gateway/status_report.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/frame.h"
#include "server/shared_memory/session_table.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr uint32_t kSessions = 1'000;
constexpr int kListed = 256;  // as proto/b4mrl.proto says

TEST_CASE("A status of many sessions with long names fits an envelope, and counts them all") {
  SharedState state = Take(SharedState::Create(limits::kMaxWorkers, limits::kLoopbackLeaseMs));
  SessionTable table(state);
  pb::OpenRequest open;
  open.set_environment("HalfCheetah");
  for (uint32_t i = 0; i < limits::kMaxPerturbations; ++i) {
    pb::NamedArgument* perturbation = open.add_perturbations();
    perturbation->set_name("gravity");
    perturbation->set_argument(std::string(400, '2'));
  }
  const std::string bytes = open.SerializeAsString();
  for (uint32_t i = 0; i < kSessions; ++i) {
    std::string token = std::to_string(i);
    token.resize(limits::kTokenBytes, 't');
    const uint32_t index = Take(table.Allocate({token, bytes, i, 1}));
    REQUIRE(table.MakeLive(index));
    state.session(index).steps = UINT64_MAX;
    state.session(index).last_activity_ms = 0;
  }
  // Counters as they may be after years.
  for (uint32_t child = 0; child < kFirstWorkerChild + limits::kMaxWorkers; ++child) {
    ChildRecord& record = state.child(child);
    record.process_id = INT32_MAX;
    record.restarts = UINT32_MAX;
    record.steps = record.query_rows = record.requests = record.errors = UINT64_MAX;
  }
  pb::Reply reply;
  DataFolder folder("/" + std::string(4'000, 'f'));
  StatusReport(state, folder).Fill(reply.mutable_server_status());
  RequireOk(SerializeEnvelope(reply).status());
  const pb::ServerStatusReply& status = reply.server_status();
  CHECK(status.sessions_size() == kListed);
  CHECK(status.session_count() == kSessions);
  uint32_t of_workers = 0;
  for (const pb::WorkerStatus& worker : status.workers()) of_workers += worker.sessions();
  CHECK(of_workers == kSessions);
}

TEST_CASE("A session's record is read once, and anew for the next session that has it") {
  SharedState state = Take(SharedState::Create(1, limits::kLoopbackLeaseMs));
  SessionTable table(state);
  DataFolder folder("/data");
  StatusReport report(state, folder);
  const auto shown = [&] {
    pb::ServerStatusReply status;
    report.Fill(&status);
    std::vector<std::string> environments;
    for (const pb::SessionStatus& session : status.sessions()) {
      environments.push_back(session.environment());
    }
    CHECK(status.session_count() == environments.size());
    return environments;
  };
  using Names = std::vector<std::string>;
  for (const std::string environment : {"Hopper", "Walker2d"}) {
    pb::OpenRequest open;
    open.set_environment(environment);
    const std::string token(limits::kTokenBytes, 't');
    REQUIRE(Take(table.Allocate({token, open.SerializeAsString(), 1, 1})) == 0);
    CHECK(shown().empty());
    REQUIRE(table.MakeLive(0));
    CHECK(shown() == Names{environment});
    state.session(0).open[0] ^= std::byte{1};  // which would show, were it read again
    CHECK(shown() == Names{environment});
    table.Free(0);
    CHECK(shown().empty());
  }
  // A damaged record is not shown.
  REQUIRE(Take(table.Allocate({std::string(limits::kTokenBytes, 't'), "", 1, 1})) == 0);
  state.session(0).checksum ^= 1;
  REQUIRE(table.MakeLive(0));
  CHECK(shown().empty());
}

TEST_CASE("A status has question marks where a path or a cut text is not UTF-8") {
  SharedState state = Take(SharedState::Create(1, limits::kLoopbackLeaseMs));
  SessionTable table(state);
  pb::OpenRequest open;
  pb::NamedArgument* perturbation = open.add_perturbations();
  perturbation->set_name("xy");
  for (int i = 0; i < 100; ++i) perturbation->mutable_argument()->append("\xc3\xa9");
  const std::string bytes = open.SerializeAsString();
  REQUIRE(
      table.MakeLive(Take(table.Allocate({std::string(limits::kTokenBytes, 't'), bytes, 1, 1}))));
  const std::pair<std::string, std::string> folders[] = {
      {"/caf\xe9", "/caf?"},  // ISO 8859-1
      {"/caf\xc3\xa9/\xe2\x82\xac", "/caf\xc3\xa9/\xe2\x82\xac"},
      {"/\xf0\x9f\x98\x80", "/\xf0\x9f\x98\x80"},
      {"/\xe2\x82", "/??"},            // cut
      {"/\xc0\xafx", "/??x"},          // could be written shorter
      {"/\xed\xa0\x80", "/???"},       // a surrogate
      {"/\xf4\x90\x80\x80", "/????"},  // beyond the last character
  };
  for (const auto& [path, shown] : folders) {
    DataFolder folder(path);
    pb::Reply reply;
    StatusReport(state, folder).Fill(reply.mutable_server_status());
    CHECK(reply.server_status().data_folder() == shown);
    const Frame envelope = Take(SerializeEnvelope(reply));
    pb::Reply parsed;
    RequireOk(ParseEnvelope(envelope, &parsed));
    REQUIRE(parsed.server_status().sessions_size() == 1);
    CHECK(parsed.server_status().sessions(0).perturbations().ends_with("\xc3\xa9?"));
  }
}

}  // namespace
}  // namespace b4mrl
