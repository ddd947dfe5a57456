// Which workers are replaced: those that stand still, at once; never those that have much to do, or
// little of the processor. And what kills from outside cost: nothing.
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "proto/base/cores.h"
#include "proto/base/rng.h"
#include "server/environments/environment.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatientMs = 900'000;  // of requests that take long on a busy machine
// Legal steps of 0.4 s of processor time: a column of cars, each close to all others.
const char kSlowHighway[] = R"({"env_id": "highway-v0", "vehicles_count": 127,
    "vehicles_density": 1000, "lanes_count": 1, "simulation_frequency": 200})";

void StepSlowly(uint32_t lanes, uint64_t steps) {
  PrivateDaemon daemon = StartDaemon({.arguments = {"--workers", "1", "--threads", "4"}});
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment highway = Take(client.Make(
      "Highway",
      {.num_envs = lanes, .seed = 1, .config = kSlowHighway, .deadline_ms = kPatientMs}));
  RequireOk(highway.Reset().status());
  const std::vector<float> actions(lanes * highway.spec().action.size());
  for (uint64_t step = 0; step < steps; ++step) {
    const Clock::time_point start = Clock::now();
    const StepOutcome outcome = Take(highway.Step(std::span<const float>(actions)));
    CAPTURE(step, SecondsSince(start));
    for (const uint8_t cause : outcome.causes) {
      REQUIRE(cause != static_cast<uint8_t>(Cause::kCrash));
    }
  }
  REQUIRE(LookAt(client, "worker-0").restarts == 0);
}

// More than three seconds for the threads that there are; without a heartbeat two are the limit.
TEST_CASE("Steps that take long are waited for, and nobody is blamed") {
  StepSlowly(8 * std::min(ProcessorCount(), 4u), 1);
}
TEST_CASE("96 lanes of steps that take long are waited for", "[.][long]") { StepSlowly(96, 2); }

void SaturateWithQueries(double seconds) {
  const uint32_t cores = ProcessorCount();
  PrivateDaemon daemon =
      StartDaemon({.arguments = {"--workers", "1", "--threads", std::to_string(2 * cores)}});
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment humanoid =
      Take(client.Make("Humanoid", {.num_envs = 0, .deadline_ms = kPatientMs}));
  constexpr size_t kRows = 256;
  const size_t observation_size = humanoid.spec().observation.size();
  const std::vector<float> observations(kRows * observation_size);
  const std::vector<float> actions(kRows * humanoid.spec().action.size());
  std::vector<float> next(observations.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> terminated(kRows), valid(kRows);
  std::vector<uint64_t> under_way;
  const Clock::time_point start = Clock::now();
  do {
    while (under_way.size() < 4 * cores) {
      under_way.push_back(Take(humanoid.SendQuery(std::span<const float>(observations),
                                                  std::span<const float>(actions), 1, 0, 0)));
    }
    const QueryOutput output = {next, rewards, terminated, valid};
    RequireOk(humanoid.ReceiveQuery(under_way.front(), output));
    under_way.erase(under_way.begin());
  } while (SecondsSince(start) < seconds);
  REQUIRE(LookAt(client, "worker-0").restarts == 0);
}

TEST_CASE("A worker with twice as many busy threads as cores is healthy") {
  SaturateWithQueries(3);
}
TEST_CASE("A minute of queries on twice as many threads as cores ends no worker", "[.][long]") {
  SaturateWithQueries(60);
}

// Seconds until worker 0 was replaced for the `restarts`-th time.
double AwaitReplacement(Client& client, uint32_t restarts) {
  const Clock::time_point start = Clock::now();
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (LookAt(client, "worker-0").restarts < restarts && !deadline.expired()) {
  }
  return SecondsSince(start);
}

TEST_CASE("A stopped worker is replaced, however busy it was, and nobody is blamed") {
  PrivateDaemon daemon = StartDaemon({.arguments = {"--workers", "1", "--threads", "2"}});
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment highway = Take(client.Make(
      "Highway", {.num_envs = 4, .seed = 1, .config = kSlowHighway, .deadline_ms = kPatientMs}));
  RequireOk(highway.Reset().status());
  ProcessView worker = LookAt(client, "worker-0");
  const std::vector<float> actions(4 * highway.spec().action.size());
  Status stepped;
  std::vector<uint8_t> causes;
  std::thread learner([&] {
    const Result<StepOutcome> outcome = highway.Step(std::span<const float>(actions));
    stepped = outcome.status();
    if (outcome.ok()) causes.assign(outcome->causes.begin(), outcome->causes.end());
  });
  for (uint32_t stops = 1; stops <= 3; ++stops) {
    worker = AwaitRequest(client, "worker-0", worker);  // so it is ready and has work
    const bool stopped = kill(worker.process_id, SIGSTOP) == 0;
    const double seconds = AwaitReplacement(client, stops);
    // limits::kFrozenChildMs, and what a busy machine adds.
    CHECK((stopped && seconds < 10));
    WARN("a stopped worker was replaced after " << seconds << " s");
  }
  learner.join();
  RequireOk(stepped);
  for (const uint8_t cause : causes) REQUIRE(cause != static_cast<uint8_t>(Cause::kCrash));
}

TEST_CASE("A thread in an endless loop is replaced, and blamed alone") {
  constexpr uint32_t kGroups = 4, kLanesPerGroup = 3, kSpinning = 4;
  PrivateDaemon daemon = StartDaemon({.binary = B4MRL_BINARY_DIR "/b4mrl-serve-faulty",
                                      .arguments = {"--workers", "1", "--threads", "2"},
                                      .environment = {"B4MRL_FAULT=spin:4:3"}});
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = Take(LaneWalk::Open(client, kGroups, kLanesPerGroup, 11));
  std::vector<double> seconds;
  std::thread observer([&] {
    Result<Client> status = Client::Connect(daemon.endpoint());
    for (uint32_t restarts = 1; status.ok() && restarts <= 2; ++restarts) {
      seconds.push_back(AwaitReplacement(*status, restarts));
    }
  });
  RequireOk(walk.Reset());
  const Status walked = walk.RunTo(10);
  observer.join();
  RequireOk(walked);
  REQUIRE(seconds.size() == 2);
  // limits::kFrozenChildMs of the processor, of which a busy machine gives it less than all.
  for (const double s : seconds) WARN("an endless loop was ended after " << s << " s");
  // Operation 3 is step 2, at index 1.
  for (uint32_t lane = 0; lane < kGroups * kLanesPerGroup; ++lane) {
    const auto expected = static_cast<uint8_t>(lane == kSpinning ? Cause::kCrash : Cause::kNone);
    REQUIRE(walk.causes(lane)[1] == expected);
  }
  REQUIRE(LookAt(client, "worker-0").restarts == 2);
}

// Sessions of different simulators, which a replacement needs a while to adopt.
std::vector<RemoteEnvironment> OpenMany(Client& client, uint32_t count) {
  std::vector<RemoteEnvironment> sessions;
  for (uint32_t i = 0; i < count; ++i) {
    const std::string gravity = std::to_string(0.5 + 0.01 * i);
    sessions.push_back(Take(client.Make(
        "Hopper",
        {.simulator = {{"gravity", gravity}}, .num_envs = 8, .deadline_ms = kPatientMs})));
    RequireOk(sessions.back().Reset().status());
  }
  return sessions;
}

// Kills worker 0 again and again, each time up to `longest_gap_ms` after the time before. False if
// that takes too long. Asserts nothing, for Catch2's assertions are the main thread's alone.
bool KillAgainAndAgain(const std::string& endpoint, int times, uint64_t longest_gap_ms) {
  Result<Client> client = Client::Connect(endpoint);
  if (!client.ok()) return false;
  Rng rng(1, "kills");
  pid_t last = 0;
  for (int i = 0; i < times; ++i) {
    const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
    const Deadline gap = Deadline::AfterMs(static_cast<int64_t>(rng.Below(longest_gap_ms + 1)));
    while (true) {
      if (deadline.expired()) return false;
      const pid_t process = LookAt(*client, "worker-0").process_id;
      if (process == 0 || process == last || !gap.expired()) continue;
      if (kill(process, SIGKILL) != 0) continue;
      last = process;
      break;
    }
  }
  return true;
}

// Walks meanwhile, and compares with an undisturbed walk.
void SurviveKills(int in_a_row, int at_random) {
  PrivateDaemon daemon = StartDaemon({.arguments = {"--workers", "1", "--threads", "2"}});
  Client client = Connect(daemon.endpoint());
  std::vector<RemoteEnvironment> sessions = OpenMany(client, 40);
  LaneWalk walk = Take(LaneWalk::Open(client, 4, 3, 11));
  RequireOk(walk.Reset());
  std::atomic<bool> done{false};
  bool all_sent = false;
  double seconds_in_a_row = 0;
  std::thread gun([&] {
    const Clock::time_point start = Clock::now();
    all_sent = KillAgainAndAgain(daemon.endpoint(), in_a_row, 0);
    seconds_in_a_row = SecondsSince(start);
    all_sent = all_sent && KillAgainAndAgain(daemon.endpoint(), at_random, 300);
    done = true;
  });
  Status status;
  while (!done && status.ok()) status = walk.Advance();
  gun.join();
  RequireOk(status);
  REQUIRE(all_sent);
  RequireOk(walk.Drain());
  REQUIRE(LookAt(client, "worker-0").restarts == static_cast<uint32_t>(in_a_row + at_random));
  // With a back-off that doubles from 10 ms to 5 s it would be a minute.
  CAPTURE(seconds_in_a_row);
  REQUIRE(seconds_in_a_row < 20);
  for (RemoteEnvironment& session : sessions) RequireOk(session.Reset().status());

  const uint64_t steps = walk.FinishedSteps();
  CAPTURE(steps);
  PrivateDaemon undisturbed = StartDaemon();
  Client other = Connect(undisturbed.endpoint());
  LaneWalk reference = Take(LaneWalk::Open(other, 4, 3, 11));
  RequireOk(reference.Reset());
  RequireOk(reference.RunTo(steps));
  for (uint32_t lane = 0; lane < 12; ++lane) {
    REQUIRE(walk.Bytes(lane, steps) == reference.Bytes(lane, steps));
  }
}

TEST_CASE("Kills of workers that adopt sessions cost nothing but time") { SurviveKills(20, 20); }
TEST_CASE("1,000 kills of workers, many that adopt sessions, cost nothing but time", "[.][long]") {
  SurviveKills(20, 1'000);
}

TEST_CASE("A worker that adopts sessions for longer than one may take is not frozen", "[.][long]") {
  constexpr uint32_t kSessions = 22;
  PrivateDaemon daemon = StartDaemon({.binary = B4MRL_BINARY_DIR "/b4mrl-serve-faulty",
                                      .arguments = {"--workers", "1"},
                                      .environment = {"B4MRL_FAULT=slow-attach:2:1000"}});
  Client client = Connect(daemon.endpoint());
  std::vector<RemoteEnvironment> sessions;
  for (uint32_t i = 0; i < kSessions; ++i) {
    sessions.push_back(Take(client.Make("Hopper", {.num_envs = 2, .deadline_ms = kPatientMs})));
    RequireOk(sessions.back().Reset().status());
  }
  // 22 s of adoption; a worker that starts is given up after 20 s without a sign of life.
  REQUIRE(kill(LookAt(client, "worker-0").process_id, SIGKILL) == 0);
  AwaitReplacement(client, 1);
  for (RemoteEnvironment& session : sessions) RequireOk(session.Reset().status());
  REQUIRE(LookAt(client, "worker-0").restarts == 1);
}

}  // namespace
}  // namespace b4mrl
