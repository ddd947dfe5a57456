// What clients notice when the daemon's processes die, freeze or crash: nothing but a pause.
#include <signal.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <thread>

#include "server/shared_memory/blame.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/queries_under_way.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr uint32_t kGroups = 4;
constexpr uint32_t kLanesPerGroup = 3;
constexpr uint32_t kLanes = kGroups * kLanesPerGroup;
constexpr uint64_t kSeed = 11;
constexpr uint8_t kLimit = 2;
constexpr uint8_t kCrash = 3;

const std::vector<std::string> kNoDoor = {"--no-door"};

PrivateDaemon StartFaulty(const std::string& fault = "", uint32_t workers = 1,
                          const std::vector<std::string>& flags = {}) {
  PrivateDaemonOptions options;
  options.binary = B4MRL_BINARY_DIR "/b4mrl-serve-faulty";
  options.tcp = true;
  options.arguments = {"--workers", std::to_string(workers), "--threads", "2"};
  options.arguments.insert(options.arguments.end(), flags.begin(), flags.end());
  if (!fault.empty()) options.environment = {"B4MRL_FAULT=" + fault};
  return StartDaemon(std::move(options));
}

// The processes that the daemon's supervisor has started.
std::vector<pid_t> Children(Client& client) {
  std::vector<pid_t> children;
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& child : status.workers()) {
    children.push_back(static_cast<pid_t>(child.process_id()));
  }
  return children;
}

// A file name that nothing has yet, for faults that are to happen once.
std::string FreshFile() {
  static int number = 0;
  const std::string path =
      (std::filesystem::temp_directory_path() /
       ("b4mrl-fault-" + std::to_string(getpid()) + "-" + std::to_string(number++)))
          .string();
  std::filesystem::remove(path);
  return path;
}

LaneWalk OpenWalk(Client& client, uint64_t seed = kSeed) {
  Result<LaneWalk> walk = LaneWalk::Open(client, kGroups, kLanesPerGroup, seed);
  INFO(walk.status().ToString());
  REQUIRE(walk.ok());
  RequireOk(walk->Reset());
  return std::move(*walk);
}

// The undisturbed walk, to compare with.
LaneWalk ReferenceWalk(uint64_t steps, uint64_t seed = kSeed) {
  static PrivateDaemon daemon = StartFaulty();
  static Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client, seed);
  RequireOk(walk.RunTo(steps));
  return walk;
}

void RequireSameBytes(const LaneWalk& walk, const LaneWalk& reference, uint64_t steps,
                      int64_t except_lane = -1) {
  for (uint32_t lane = 0; lane < kLanes; ++lane) {
    if (lane == except_lane) continue;
    INFO("lane " << lane << " of " << steps << " steps");
    REQUIRE(walk.Bytes(lane, steps) == reference.Bytes(lane, steps));
  }
}

TEST_CASE("100 kills of a stepping worker change no byte of any trajectory") {
  PrivateDaemon daemon = StartFaulty();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  WalkUnderFire(walk, daemon.endpoint(), {"worker-0", SIGKILL, 100, 20});
  const uint64_t steps = walk.FinishedSteps();
  CAPTURE(steps);
  REQUIRE(LookAt(*client, "worker-0").restarts == 100);
  RequireSameBytes(walk, ReferenceWalk(steps), steps);
}

TEST_CASE("Kills of the gateway do not touch a stepping client") {
  PrivateDaemon daemon = StartFaulty();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  WalkUnderFire(walk, daemon.endpoint(), {"gateway", SIGKILL, 5});
  const uint64_t steps = walk.FinishedSteps();
  RequireSameBytes(walk, ReferenceWalk(steps), steps);
  // The replacement knows the old sessions and opens new ones on other lanes.
  LaneWalk second = OpenWalk(*client, kSeed + 100);
  RequireOk(second.RunTo(5));
  RequireOk(walk.RunTo(steps + 45));
  RequireSameBytes(walk, ReferenceWalk(steps + 45), steps + 45);
}

TEST_CASE("A frozen worker is replaced and changes no byte") {
  PrivateDaemon daemon = StartFaulty();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  WalkUnderFire(walk, daemon.endpoint(), {"worker-0", SIGSTOP, 2, 20});
  const uint64_t before = walk.FinishedSteps();
  RequireOk(walk.RunTo(before + 45));
  RequireSameBytes(walk, ReferenceWalk(before + 45), before + 45);
}

TEST_CASE("A worker killed at a chosen point of one operation repeats it exactly once") {
  const std::string kind = GENERATE("tear-once", "kill-after-once", "hang-once");
  // Lane 4, operation 30; the session's lanes are the daemon's first.
  const std::string file = FreshFile();
  PrivateDaemon daemon = StartFaulty(kind + ":4:30:" + file);
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  RequireOk(walk.RunTo(60));
  CAPTURE(kind);
  REQUIRE(std::filesystem::remove(file));  // it did happen
  REQUIRE(LookAt(*client, "worker-0").restarts == 1);
  RequireSameBytes(walk, ReferenceWalk(60), 60);
}

TEST_CASE("A step that always ends its process ends only its own lane's episode") {
  const std::string kind = GENERATE("crash", "exit", "hang");
  PrivateDaemon daemon = StartFaulty(kind + ":4:30");
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  RequireOk(walk.RunTo(90));
  CAPTURE(kind);
  const LaneWalk reference = ReferenceWalk(90);
  RequireSameBytes(walk, reference, 90, 4);
  // Operation 30 is step 29 (the reset was the first), at index 28.
  REQUIRE(walk.causes(4)[28] == kCrash);
  REQUIRE(walk.Bytes(4, 28) == reference.Bytes(4, 28));
  // Index 29 is the reset of mode next_step; from there the next episode runs to its limit of 40
  // steps.
  REQUIRE(walk.causes(4)[29] == 0);
  REQUIRE(walk.causes(4)[29 + 40] == kLimit);
  REQUIRE(LookAt(*client, "worker-0").restarts == 2);
}

TEST_CASE("A query that always ends its process is refused, and the session's steps go on") {
  PrivateDaemon daemon = StartFaulty("crash-query:7");
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  LaneWalk walk = OpenWalk(*client);
  RequireOk(walk.RunTo(10));
  std::vector<float> observations(10 * 17), actions(10 * 6), next(10 * 17);
  std::vector<double> rewards(10);
  std::vector<uint8_t> terminated(10), valid(10);
  const Status status =
      walk.environment().Query(observations, actions, {next, rewards, terminated, valid});
  INFO(status.ToString());
  REQUIRE(status.code() == StatusCode::kInternal);
  RequireOk(walk.RunTo(50));
  RequireSameBytes(walk, ReferenceWalk(50), 50);
}

TEST_CASE("A snapshot that always ends its process is refused, and the session's steps go on") {
  PrivateDaemon daemon = StartFaulty("crash-snapshot:4");
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  RequireOk(walk.RunTo(10));
  const uint32_t others[] = {3, 5}, guilty[] = {4};
  RequireOk(walk.environment().Snapshot(others).status());
  const Status status = walk.environment().Snapshot(guilty).status();
  INFO(status.ToString());
  REQUIRE(status.code() == StatusCode::kInternal);
  REQUIRE(LookAt(client, "worker-0").restarts == 2);
  RequireOk(walk.RunTo(50));
  RequireSameBytes(walk, ReferenceWalk(50), 50);
}

TEST_CASE("A restore that always ends its process is refused and changes no lane") {
  PrivateDaemon daemon = StartFaulty("crash-restore:4");
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  RequireOk(walk.RunTo(5));
  LaneStates states = Take(walk.environment().Snapshot());
  states.snapshot.clear();  // so that the parts are restored
  RequireOk(walk.RunTo(10));
  const Status status = walk.environment().Restore(states).status();
  INFO(status.ToString());
  REQUIRE(status.code() == StatusCode::kFailedPrecondition);
  REQUIRE(LookAt(client, "worker-0").restarts == 2);
  RequireOk(walk.RunTo(50));
  RequireSameBytes(walk, ReferenceWalk(50), 50);
}

TEST_CASE("A session whose opening always ends its worker is refused, and others are opened") {
  PrivateDaemon daemon = StartFaulty("crash-attach:7");
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  const Status status = client->Make("HalfCheetah", {.num_envs = 7}).status();
  INFO(status.ToString());
  REQUIRE(status.code() == StatusCode::kInternal);
  REQUIRE(LookAt(*client, "worker-0").restarts == kMaxBuildDeaths);
  LaneWalk walk = OpenWalk(*client);
  RequireOk(walk.RunTo(10));
  RequireSameBytes(walk, ReferenceWalk(10), 10);
}

TEST_CASE("SIGTERM under load drains: what was begun is answered, exit code 0, nobody left") {
  const bool door = GENERATE(true, false);
  CAPTURE(door);
  PrivateDaemon daemon = StartFaulty("", 2, door ? std::vector<std::string>() : kNoDoor);
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenWalk(client);
  RequireOk(walk.RunTo(5));
  REQUIRE((walk.environment().transport() == "door") == door);
  const std::vector<pid_t> children = Children(client);
  REQUIRE(children.size() == 4);
  QueriesUnderWay queries(client, walk.environment(), "worker-0");
  const Clock::time_point start = Clock::now();
  REQUIRE(kill(daemon.process_id(), SIGTERM) == 0);
  queries.RequireAnswers();
  const int wait_status = daemon.Stop();
  REQUIRE(WIFEXITED(wait_status));
  REQUIRE(WEXITSTATUS(wait_status) == 0);
  REQUIRE(SecondsSince(start) < 5);  // limits::kDrainMs; it takes about 0.5 s
  for (const pid_t child : children) REQUIRE(kill(child, 0) != 0);
}

TEST_CASE("A second signal ends what the first one waits for") {
  PrivateDaemon daemon = StartFaulty("hang:0:2");
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  RemoteEnvironment environment = Take(client->Make("HalfCheetah"));
  RequireOk(environment.Reset().status());
  const ProcessView before = LookAt(*client, "worker-0");
  const std::vector<float> action(environment.spec().action.size(), 0.5f);
  RequireOk(environment.Send(std::span<const float>(action)).status());
  AwaitRequest(*client, "worker-0", before);
  const Clock::time_point start = Clock::now();
  REQUIRE(kill(daemon.process_id(), SIGTERM) == 0);
  // The first has been read when openings are refused; another one counts a tenth of a second
  // later.
  while (client->Make("HalfCheetah").status().code() != StatusCode::kUnavailable &&
         SecondsSince(start) < 4) {
  }
  for (const Clock::time_point refused = Clock::now(); SecondsSince(refused) < 0.2;) {
    (void)client->ServerStatus();
  }
  const int wait_status = daemon.Stop();
  REQUIRE(WIFEXITED(wait_status));
  REQUIRE(WEXITSTATUS(wait_status) == 0);
  REQUIRE(SecondsSince(start) < 4.5);  // limits::kDrainMs is 5 s
}

TEST_CASE("No process survives a supervisor that is killed") {
  PrivateDaemon daemon = StartFaulty("", 2);
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  const std::vector<pid_t> children = Children(*client);
  REQUIRE(children.size() == 4);
  REQUIRE(kill(daemon.process_id(), SIGKILL) == 0);
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  for (const pid_t child : children) {
    // A zombie that nobody has reaped yet counts as gone; its command line is empty.
    const auto gone = [child] {
      if (kill(child, 0) != 0) return true;
      std::error_code error;
      return !std::filesystem::exists("/proc/" + std::to_string(child) + "/exe", error);
    };
    while (!gone() && !deadline.expired()) std::this_thread::yield();
    REQUIRE(gone());
  }
}

}  // namespace
}  // namespace b4mrl
