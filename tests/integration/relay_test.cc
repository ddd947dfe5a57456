// Clients that reach only the gateway's port: everything works, nothing changes but the time.
#include <signal.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/network_namespace.h"
#include "tests/integration/support/queries_under_way.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr uint32_t kGroups = 3;
constexpr uint32_t kLanesPerGroup = 2;
constexpr uint64_t kSeed = 5;

PrivateDaemon Start(std::vector<std::string> flags, bool tcp = true) {
  flags.insert(flags.begin(), {"--workers", "2", "--threads", "2"});
  return StartDaemon({.tcp = tcp, .arguments = std::move(flags)});
}

PrivateDaemon StartSinglePort(bool tcp = true) { return Start({"--single-port"}, tcp); }

LaneWalk OpenWalk(Client& client) {
  Result<LaneWalk> walk = LaneWalk::Open(client, kGroups, kLanesPerGroup, kSeed);
  INFO(walk.status().ToString());
  REQUIRE(walk.ok());
  REQUIRE(walk->Reset().ok());
  return std::move(*walk);
}

// Compares with the same walk on the direct way.
void RequireDirectBytes(const LaneWalk& walk) {
  const uint64_t steps = walk.FinishedSteps();
  CAPTURE(steps);
  REQUIRE(steps > 0);
  PrivateDaemon daemon = Start({});
  Client client = Connect(daemon.endpoint());
  LaneWalk direct = OpenWalk(client);
  REQUIRE_FALSE(client.relayed());
  REQUIRE(direct.RunTo(steps).ok());
  for (uint32_t lane = 0; lane < kGroups * kLanesPerGroup; ++lane) {
    CAPTURE(lane);
    REQUIRE(walk.Bytes(lane, steps) == direct.Bytes(lane, steps));
  }
}

TEST_CASE("With --single-port the daemon listens on one port, and everything works through it") {
  const bool tcp = GENERATE(true, false);
  CAPTURE(tcp);
  PrivateDaemon daemon = StartSinglePort(tcp);
  REQUIRE(ListeningPorts(daemon.process_id()).size() == (tcp ? 1 : 0));
  Client client = Connect(daemon.endpoint());
  std::vector<std::string> reports;
  client.set_reporter([&reports](const std::string& text) { reports.push_back(text); });
  REQUIRE(client.hello().dataset_port().tcp() == 0);
  REQUIRE(client.hello().dataset_port().ipc().empty());
  REQUIRE(client.ListDatasets().ok());
  REQUIRE(client.OpenDataset("Nowhere/never").status().code() == StatusCode::kUnknownName);
  LaneWalk walk = OpenWalk(client);
  REQUIRE(walk.environment().in_force().port().tcp() == 0);
  REQUIRE(walk.RunTo(60).ok());
  const Result<LaneStates> states = walk.environment().Snapshot();
  REQUIRE(states.ok());
  REQUIRE(walk.environment().Restore(*states).ok());
  const auto sessions = [&client] {
    const Result<pb::ServerStatusReply> status = client.ServerStatus();
    REQUIRE(status.ok());
    return status->session_count();
  };
  REQUIRE(sessions() == 1);
  REQUIRE(walk.environment().Close().ok());
  REQUIRE(sessions() == 0);
  RequireDirectBytes(walk);
  // The slower way is told of once, however much goes it.
  REQUIRE(reports.size() == 1);
  REQUIRE(reports[0].find("slower") != std::string::npos);
  const int wait_status = daemon.Stop();
  REQUIRE(WIFEXITED(wait_status));
  REQUIRE(WEXITSTATUS(wait_status) == 0);
}

TEST_CASE("A single port leaves no files behind") {
  const TemporaryFolder folder;
  PrivateDaemon daemon =
      StartDaemon({.tcp = true,
                   .data_folder = folder.path(),
                   .arguments = {"--workers", "1", "--threads", "1", "--single-port"},
                   .environment = {"TMPDIR=" + folder.path()}});
  const auto sockets = [&folder] {
    size_t count = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path())) {
      count += entry.is_socket() ? 1 : 0;
    }
    return count;
  };
  REQUIRE(sockets() == 2);  // the worker's and the dataset worker's
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    if (entry.path().filename().string().starts_with("b4mrl-")) {
      REQUIRE(entry.status().permissions() == std::filesystem::perms::owner_all);
    }
  }
  daemon.Stop();
  REQUIRE(sockets() == 0);
}

TEST_CASE("Kills of a worker behind the relay change no byte") {
  PrivateDaemon daemon = StartSinglePort();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  WalkUnderFire(walk, daemon.endpoint(), {"worker-0", SIGKILL, 20, 20});
  REQUIRE(LookAt(client, "worker-0").restarts == 20);
  RequireDirectBytes(walk);
}

TEST_CASE("Kills of the gateway that relays change no byte") {
  PrivateDaemon daemon = StartSinglePort();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  WalkUnderFire(walk, daemon.endpoint(), {"gateway", SIGKILL, 20});
  REQUIRE(LookAt(client, "gateway").restarts == 20);
  RequireDirectBytes(walk);
}

TEST_CASE("A worker that does not answer holds up nobody at the gateway") {
  PrivateDaemon daemon = StartSinglePort();
  Client client = Connect(daemon.endpoint());
  Result<RemoteEnvironment> environment = client.Make("HalfCheetah");
  REQUIRE(environment.ok());
  REQUIRE(environment->Reset().ok());
  const pid_t worker = LookAt(client, "worker-0").process_id;
  // A supervisor that stands still replaces nobody, so a gateway that waited for the worker would
  // never answer.
  REQUIRE(kill(daemon.process_id(), SIGSTOP) == 0);
  const bool stopped = kill(worker, SIGSTOP) == 0;
  const std::vector<float> action(6, 0.1f);
  const bool sent = environment->Send(std::span<const float>(action)).ok();
  int answers = 0;
  while (answers < 20 && client.ServerStatus().ok()) ++answers;
  const pid_t meanwhile = LookAt(client, "worker-0").process_id;
  REQUIRE(kill(daemon.process_id(), SIGCONT) == 0);
  REQUIRE(stopped);
  REQUIRE(sent);
  REQUIRE(answers == 20);
  REQUIRE(meanwhile == worker);
  REQUIRE(environment->Receive().ok());
  REQUIRE(LookAt(client, "worker-0").process_id != worker);
}

TEST_CASE("SIGTERM under relayed load drains in time, and what was begun is answered") {
  PrivateDaemon daemon = StartSinglePort();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  REQUIRE(walk.RunTo(5).ok());
  QueriesUnderWay queries(client, walk.environment(), "worker-0");
  const Clock::time_point start = Clock::now();
  REQUIRE(kill(daemon.process_id(), SIGTERM) == 0);
  queries.RequireAnswers();
  const int wait_status = daemon.Stop();
  REQUIRE(WIFEXITED(wait_status));
  REQUIRE(WEXITSTATUS(wait_status) == 0);
  REQUIRE(SecondsSince(start) < 4);  // below limits::kDrainMs, which a lost request would take
}

}  // namespace
}  // namespace b4mrl
