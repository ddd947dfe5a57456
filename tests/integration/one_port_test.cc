// A client in a network namespace from which one port of the daemon can be reached: the gateway's.
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <memory>
#include <vector>

#include "proto/wire/descriptors.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/network_namespace.h"
#include "tests/integration/support/port_forwarder.h"
#include "tests/loopback.h"

namespace b4mrl {
namespace {

constexpr uint32_t kGroups = 2;
constexpr uint32_t kLanesPerGroup = 2;
constexpr uint64_t kSteps = 60;  // an end and a reset of every lane among them
constexpr uint64_t kSeed = 9;

PrivateDaemon Start() {
  return StartDaemon({.tcp = true, .arguments = {"--workers", "2", "--threads", "1"}});
}

// Two sessions and a question about datasets; writes all bytes of the first session to `file`.
// Reports of the slower way are counted in *reports.
Status UseDaemon(const std::string& endpoint, const std::string& file, int* reports) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  client.set_reporter([reports](const std::string&) { ++*reports; });
  B4MRL_ASSIGN_OR_RETURN(LaneWalk walk, LaneWalk::Open(client, kGroups, kLanesPerGroup, kSeed));
  B4MRL_RETURN_IF_ERROR(walk.Reset());
  B4MRL_RETURN_IF_ERROR(walk.RunTo(kSteps));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment second, client.Make("HalfCheetah"));
  B4MRL_RETURN_IF_ERROR(second.Reset().status());
  B4MRL_RETURN_IF_ERROR(client.ListDatasets().status());
  B4MRL_RETURN_IF_ERROR(second.Close());
  std::string bytes;
  for (uint32_t lane = 0; lane < kGroups * kLanesPerGroup; ++lane)
    bytes += walk.Bytes(lane, kSteps);
  WriteBytes(file, bytes);
  return Status();
}

enum class Wall { kRefuses, kSilent };

// What the child does: opens the hole in the wall, then is a client. Exit codes tell what failed.
int BeClient(int channel, const std::string& endpoint, uint16_t port,
             const std::set<uint16_t>& other_ports, Wall wall, const std::string& file) {
  const UniqueFd hole = ListenOnLoopback(port);
  if (!hole.valid()) return 2;
  if (!SendWithDescriptors(channel, "", 1, std::array{hole.get()})) return 5;
  // Connections to these are made, but nobody ever says a word.
  std::vector<UniqueFd> silent;
  if (wall == Wall::kSilent) {
    for (const uint16_t other : other_ports) {
      silent.push_back(ListenOnLoopback(other));
      if (!silent.back().valid()) return 3;
    }
  }
  int reports = 0;
  if (const Status status = UseDaemon(endpoint, file, &reports); !status.ok()) {
    (void)!write(STDERR_FILENO, status.ToString().c_str(), status.ToString().size());
    return 4;
  }
  return reports == 1 ? 0 : 10 + reports;
}

TEST_CASE("A client that reaches only the gateway's port goes through the relay and says so once") {
  const Wall wall = GENERATE(Wall::kRefuses, Wall::kSilent);
  CAPTURE(static_cast<int>(wall));
  const TemporaryFolder folder;
  PrivateDaemon daemon = Start();
  const Result<TcpAddress> address = ParseTcpAddress(daemon.endpoint());
  REQUIRE(address.ok());
  std::set<uint16_t> others = ListeningPorts(daemon.process_id());
  REQUIRE(others.erase(address->port) == 1);
  REQUIRE(others.size() == 3);  // two workers and the dataset worker
  int channel = -1;
  const pid_t child = RunIsolated(
      [&](int child_channel) {
        return BeClient(child_channel, daemon.endpoint(), address->port, others, wall,
                        folder.File("relayed"));
      },
      &channel);
  REQUIRE(child > 0);
  char byte = 0;
  UniqueFd hole = ReceiveWithDescriptor(channel, &byte, sizeof(byte), 0);
  std::unique_ptr<PortForwarder> forwarder;
  if (hole.valid()) {
    forwarder = std::make_unique<PortForwarder>(hole.Release(), address->port);
  }
  int wait_status = 0;
  REQUIRE(waitpid(child, &wait_status, 0) == child);
  close(channel);
  REQUIRE(WIFEXITED(wait_status));
  if (WEXITSTATUS(wait_status) == kNoNamespaces) {
    WARN("skipped: this system allows no network namespaces");
    return;
  }
  REQUIRE(WEXITSTATUS(wait_status) == 0);
  REQUIRE(forwarder != nullptr);
  REQUIRE(forwarder->connections() >= 3);  // Hello, and one each for two sessions

  int reports = 0;
  const Status direct = UseDaemon(daemon.endpoint(), folder.File("direct"), &reports);
  INFO(direct.ToString());
  REQUIRE(direct.ok());
  REQUIRE(reports == 0);
  REQUIRE(ReadBytes(folder.File("relayed")) == ReadBytes(folder.File("direct")));
}

}  // namespace
}  // namespace b4mrl
