// Sessions that are closed while they open, or whose processes die meanwhile: none keeps its lanes.
#include <fmt/format.h>
#include <signal.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <set>

#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/raw_peer.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr uint32_t kWorkers = 2;
constexpr uint32_t kLargestSessions = limits::kMaxLanes / limits::kMaxLanesPerSession;

PrivateDaemon Start() {
  return StartDaemon(
      {.arguments = {"--workers", std::to_string(kWorkers), "--threads", "2", "--lease", "3"}});
}

// A new one with every call.
std::string NextToken() {
  static uint64_t number = 0;
  return fmt::format("{:0{}}", ++number, limits::kTokenBytes);
}

pb::Request OpenRequest(uint32_t lanes) {
  pb::Request request;
  request.mutable_open()->set_environment("HalfCheetah");
  request.mutable_open()->set_num_envs(lanes);
  return request;
}

pb::Request CloseRequest() {
  pb::Request request;
  request.mutable_close();
  return request;
}

StatusCode CodeOf(const pb::Reply& reply) { return GetStatus(reply.status()).code(); }

// Connections to the gateway and to every worker.
struct Peers {
  explicit Peers(const std::string& gateways) : endpoint(gateways), gateway(context, gateways) {
    std::vector<std::string> tokens;
    for (uint32_t i = 0; i < kWorkers; ++i) {
      tokens.push_back(NextToken());
      const pb::Reply opened = gateway.Call(OpenRequest(1), tokens.back(), kFirePatienceMs);
      REQUIRE(CodeOf(opened) == StatusCode::kOk);
      addresses.insert(AddressOf(opened.open().port()));
    }
    REQUIRE(addresses.size() == kWorkers);
    for (const std::string& address : addresses) workers.emplace_back(context, address);
    for (const std::string& token : tokens) Close(token);
  }
  // At every worker: one of them has it.
  void Close(const std::string& token) {
    for (RawPeer& worker : workers) worker.Send(CloseRequest(), token);
    for (RawPeer& worker : workers) REQUIRE(worker.AwaitAll(kFirePatienceMs));
  }

  Context context;
  std::string endpoint;
  RawPeer gateway;
  std::set<std::string> addresses;  // of the workers
  std::vector<RawPeer> workers;
};

// No session is left once the lease is over, and all lanes can be had.
void RequireAllLanesFree(Client& client, Peers& peers) {
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (Take(client.ServerStatus()).session_count() > 0) REQUIRE_FALSE(deadline.expired());
  std::vector<std::string> tokens;
  for (uint32_t i = 0; i < kLargestSessions; ++i) {
    tokens.push_back(NextToken());
    const pb::Reply opened = peers.gateway.Call(OpenRequest(limits::kMaxLanesPerSession),
                                                tokens.back(), kFirePatienceMs);
    INFO("session " << i << ": " << opened.status().message());
    REQUIRE(CodeOf(opened) == StatusCode::kOk);
  }
  for (const std::string& token : tokens) peers.Close(token);
}

// Sends `opens` Opens, each with a dozen Closes to every worker, and waits for no answer.
void OpenAndClose(Peers& peers, uint32_t opens, uint32_t lanes) {
  constexpr int kCloses = 12;
  for (uint32_t i = 0; i < opens; ++i) {
    const std::string token = NextToken();
    peers.gateway.Send(OpenRequest(lanes), token);
    for (int close = 0; close < kCloses; ++close) {
      for (RawPeer& worker : peers.workers) worker.Send(CloseRequest(), token);
    }
  }
  REQUIRE(peers.gateway.AwaitAll(kFirePatienceMs));
  for (RawPeer& worker : peers.workers) REQUIRE(worker.AwaitAll(kFirePatienceMs));
}

void CloseWhileOpening(uint32_t opens) {
  PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  Peers peers(daemon.endpoint());
  OpenAndClose(peers, opens, 1);
  OpenAndClose(peers, 50, limits::kMaxLanesPerSession);
  RequireAllLanesFree(client, peers);
}

TEST_CASE("Sessions that are closed while they open leave no lane behind") {
  CloseWhileOpening(200);
}
TEST_CASE("3,000 sessions that are closed while they open leave no lane behind", "[.][long]") {
  CloseWhileOpening(3'000);
}

TEST_CASE("A session that is closed while its model is compiled does not come to be") {
  const TemporaryFolder folder;
  const std::string models = folder.File("models");
  std::filesystem::create_directories(models);
  WriteBytes(models + "/own.xml", ReadBytes(B4MRL_SOURCE_DIR "/data/models/half_cheetah.xml"));
  PrivateDaemon daemon =
      StartDaemon({.data_folder = folder.path(),
                   .arguments = {"--workers", "1", "--threads", "1", "--models", models}});
  Client client = Connect(daemon.endpoint());
  Context context;
  RawPeer gateway(context, daemon.endpoint());
  pb::Request open = OpenRequest(1);
  pb::NamedArgument* model = open.mutable_open()->add_perturbations();
  model->set_name("model");
  model->set_argument("own.xml");
  const std::string token = NextToken();
  gateway.Send(open, token);
  gateway.Send(CloseRequest(), token);
  REQUIRE(gateway.AwaitAll(kFirePatienceMs));
  // Should the session exist, it would for an hour: nobody else knows its token.
  CHECK(Take(client.ServerStatus()).session_count() == 0);
}

TEST_CASE("SIGTERM answers the Opens that wait for their workers, and the daemon ends in time") {
  constexpr int kOpens = 60;
  PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  Context context;
  RawPeer gateway(context, daemon.endpoint());
  for (int i = 0; i < kOpens; ++i) {  // each has its own simulator, which takes a while to build
    pb::Request open = OpenRequest(0);
    open.mutable_open()->set_environment("Humanoid");
    pb::NamedArgument* gravity = open.mutable_open()->add_perturbations();
    gravity->set_name("gravity");
    gravity->set_argument(fmt::format("{}", 0.5 + 0.01 * i));
    gateway.Send(open, NextToken());
  }
  REQUIRE(client.ServerStatus().ok());  // so at least the first of them were read
  const Clock::time_point start = Clock::now();
  daemon.Stop();
  CHECK(SecondsSince(start) < 4);  // below limits::kDrainMs, which a lost Open would take
  REQUIRE(gateway.AwaitAll(1'000));
  for (const auto& [code, count] : gateway.answers()) {
    INFO(count << " answers with code " << static_cast<int>(code));
    CHECK((code == StatusCode::kOk || code == StatusCode::kUnavailable));
  }
}

bool IsStoppedOrGone(pid_t process) {
  std::string line;
  std::getline(std::ifstream(fmt::format("/proc/{}/stat", process)), line);
  return line.empty() || line.find(") T ") != std::string::npos ||
         line.find(") Z ") != std::string::npos;
}

// Sends `signal` and waits until the process has stopped or ended, unless it is to go on.
void Signal(pid_t process, int signal) {
  REQUIRE(kill(process, signal) == 0);
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (signal != SIGCONT && !IsStoppedOrGone(process)) REQUIRE_FALSE(deadline.expired());
}

// The worker answers an Attach and dies before the gateway, which is stopped, reads the answer.
void DieBeforeTheAcknowledgement(Client& client, Peers& peers) {
  const ProcessView gateway = LookAt(client, "gateway");
  const std::string token = NextToken();
  // Both are idle, so it is worker 0's.
  const ProcessView worker = LookAt(client, "worker-0");
  Signal(worker.process_id, SIGSTOP);
  peers.gateway.Send(OpenRequest(2), token);
  REQUIRE(client.ServerStatus().ok());  // so the Open before it was read
  Signal(gateway.process_id, SIGSTOP);
  Signal(worker.process_id, SIGCONT);
  // The Attach was there before these.
  for (int i = 0; i < 5; ++i) {
    for (RawPeer& peer : peers.workers) peer.Call(CloseRequest(), NextToken(), kFirePatienceMs);
  }
  Signal(worker.process_id, SIGKILL);
  // The replacement answers once it has adopted what it is to adopt.
  for (const std::string& address : peers.addresses) {
    RawPeer(peers.context, address).Call(CloseRequest(), NextToken(), kFirePatienceMs);
  }
  Signal(gateway.process_id, SIGCONT);
  if (!peers.gateway.AwaitAll(10'000)) {
    // It was stopped for so long that it was replaced, and a client asks again.
    peers.gateway = RawPeer(peers.context, peers.endpoint);
    peers.gateway.Call(OpenRequest(2), token, kFirePatienceMs);
  }
  const pb::Reply opened = peers.gateway.last();
  REQUIRE(CodeOf(opened) == StatusCode::kOk);
  // A snapshot of lanes that were never reset is the shortest request that needs a session.
  RawPeer session(peers.context, AddressOf(opened.open().port()));
  pb::Request snapshot;
  snapshot.mutable_snapshot();
  REQUIRE(CodeOf(session.Call(snapshot, token, kFirePatienceMs)) == StatusCode::kOk);
  REQUIRE(CodeOf(session.Call(CloseRequest(), token, kFirePatienceMs)) == StatusCode::kOk);
}

void DieAgainAndAgain(int times) {
  PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  Peers peers(daemon.endpoint());
  for (int i = 0; i < times; ++i) {
    INFO("death " << i);
    DieBeforeTheAcknowledgement(client, peers);
  }
  RequireAllLanesFree(client, peers);
}

TEST_CASE(
    "A session whose worker dies once it was built, and before the gateway knows, is served") {
  DieAgainAndAgain(5);
}
TEST_CASE("100 workers that die once a session was built lose none", "[.][long]") {
  DieAgainAndAgain(100);
}

}  // namespace
}  // namespace b4mrl
