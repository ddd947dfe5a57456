// Ledgers of a daemon: who counts what in them, and what they outlive.
#include <signal.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "data/d4rl/dataset_file_writer.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/raw_peer.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr uint32_t kLanes = 2;

PrivateDaemon Start(std::vector<std::string> arguments = {}) {
  arguments.insert(arguments.end(), {"--workers", "1", "--threads", "2"});
  return StartDaemon({.arguments = std::move(arguments)});
}

// A session of kLanes lanes that counts in `ledger`; episodes have two steps.
RemoteEnvironment OpenCounted(Client& client, uint64_t ledger) {
  RemoteEnvironment session =
      Take(client.Make("HalfCheetah", {.num_envs = kLanes,
                                       .autoreset_mode = AutoresetMode::kSameStep,
                                       .config = R"({"max_episode_steps": 2})",
                                       .ledger = ledger}));
  RequireOk(session.Reset().status());
  return session;
}

void Step(RemoteEnvironment& session) {
  const std::vector<float> actions(kLanes * session.spec().action.size(), 0.25f);
  RequireOk(session.Step(std::span(actions)).status());
}

// Kills the process of that role and waits until its successor runs.
void Kill(Client& client, const std::string& role) {
  const ProcessView before = LookAt(client, role);
  REQUIRE(kill(before.process_id, SIGKILL) == 0);
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (!deadline.expired()) {
    const ProcessView now = LookAt(client, role);
    if (now.process_id != 0 && now.restarts > before.restarts) return;
  }
  FAIL("no successor");
}

TEST_CASE("A ledger counts the sessions that name it, and no others") {
  const PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  const uint64_t mine = Take(client.OpenLedger()), other = Take(client.OpenLedger());
  CHECK(mine != other);
  RemoteEnvironment first = OpenCounted(client, mine), second = OpenCounted(client, mine);
  RemoteEnvironment foreign = OpenCounted(client, other), uncounted = OpenCounted(client, 0);
  for (RemoteEnvironment* session : {&first, &second, &second, &foreign, &uncounted}) {
    Step(*session);
  }
  CHECK(Take(client.ReadLedger(mine)) == LedgerCounts{.steps = 6, .episodes = 2});
  CHECK(Take(client.ReadLedger(other)) == LedgerCounts{.steps = 2});

  const std::vector<float> observations(3 * 17, 0.1f), actions(3 * 6, 0.25f);
  std::vector<float> next(observations.size());
  std::vector<double> rewards(3);
  std::vector<uint8_t> terminated(3), valid(3);
  RequireOk(first.Query(std::span(observations), std::span(actions),
                        QueryOutput{next, rewards, terminated, valid}));
  RequireOk(first.Close());
  CHECK(Take(client.ReadLedger(mine)) == LedgerCounts{.steps = 6, .episodes = 2, .query_rows = 3});
  CHECK(Connect(daemon.endpoint()).ReadLedger(mine).ok());  // whoever knows the number
}

TEST_CASE("A ledger goes on after the deaths of the worker and of the gateway") {
  const PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  const uint64_t ledger = Take(client.OpenLedger());
  RemoteEnvironment session = OpenCounted(client, ledger);
  Step(session);
  Kill(client, "worker-0");
  Step(session);
  CHECK(Take(client.ReadLedger(ledger)) == LedgerCounts{.steps = 4, .episodes = 2});
  Kill(client, "gateway");
  Step(session);
  CHECK(Take(client.ReadLedger(ledger)) == LedgerCounts{.steps = 6, .episodes = 2});
}

TEST_CASE("A ledger counts what the relay passes on, rows of a dataset included") {
  const TemporaryFolder data;
  std::filesystem::create_directories(data.File("HalfCheetah"));
  DatasetWriter writer = Take(DatasetWriter::Create(
      data.File("HalfCheetah/tiny.h5"), {.observation_dimensions = 17, .action_dimensions = 6}));
  const std::vector<float> observations(4 * 17), actions(4 * 6), rewards(4);
  const std::vector<uint8_t> flags(4);
  RequireOk(writer.Append({{.rows = 4,
                            .observations = observations,
                            .actions = actions,
                            .rewards = rewards,
                            .next_observations = observations,
                            .terminals = flags,
                            .timeouts = flags}}));
  RequireOk(writer.Commit());
  const PrivateDaemon daemon =
      StartDaemon({.tcp = true, .data_folder = data.path(), .arguments = {"--single-port"}});
  Client client = Connect(daemon.endpoint());
  client.set_reporter([](const std::string&) {});
  const uint64_t ledger = Take(client.OpenLedger());
  RemoteEnvironment session = OpenCounted(client, ledger);
  Step(session);
  RemoteDataset dataset = Take(client.OpenDataset("HalfCheetah/tiny", {.ledger = ledger}));
  RequireOk(dataset.Sample(10, /*seed=*/1, /*first_batch=*/0, /*batches=*/2).status());
  RequireOk(dataset.Read(1, 3).status());
  CHECK(client.relayed());
  CHECK(Take(client.ReadLedger(ledger)) == LedgerCounts{.steps = 2, .dataset_rows = 23});
}

TEST_CASE("Numbers that no ledger has are refused by name, and more ledgers than there may be") {
  const PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  const uint64_t first = Take(client.OpenLedger());
  for (const uint64_t wrong : {uint64_t{1}, first + limits::kMaxLedgers, UINT64_MAX}) {
    const Status status = client.ReadLedger(wrong).status();
    CHECK(status.code() == StatusCode::kUnknownName);
    CHECK_THAT(status.message(), Catch::Contains(std::to_string(wrong)));
  }
  CHECK(client.ReadLedger(0).status().code() == StatusCode::kInvalidArgument);
  for (uint32_t i = 1; i < limits::kMaxLedgers; ++i) RequireOk(client.OpenLedger().status());
  CHECK(client.OpenLedger().status().code() == StatusCode::kLimitExceeded);
  CHECK(client.ReadLedger(first).ok());
  RemoteEnvironment session = OpenCounted(client, UINT64_MAX);
  Step(session);  // a number that nobody has disturbs no session
}

TEST_CASE("Workers leave the request for a ledger to the gateway") {
  const PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment session = OpenCounted(client, 0);
  Context context;
  for (const pb::Port& port : {session.in_force().port(), client.hello().dataset_port()}) {
    RawPeer peer(context, AddressOf(port));
    pb::Request request;
    request.mutable_ledger();
    const pb::Reply reply = peer.Call(request, "", 30'000);
    CHECK(static_cast<StatusCode>(reply.status().code()) == StatusCode::kUnsupported);
  }
}

}  // namespace
}  // namespace b4mrl
