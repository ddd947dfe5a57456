// What clients of a local door notice when either side is killed or stopped: nothing, or a pause.
#include <fmt/format.h>
#include <signal.h>

#include <catch2/catch.hpp>
#include <functional>

#include "proto/base/rng.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/door_clients.h"

namespace b4mrl {
namespace {

// Whether to go on after `count` times: until a number of times, or for some seconds.
using GoesOn = std::function<bool(int count)>;

GoesOn Times(int times) {
  return [times](int count) { return count < times; };
}

GoesOn Seconds(double seconds) {
  return [seconds, start = Clock::now()](int) { return SecondsSince(start) < seconds; };
}

// --- Killed workers ---

// Kills each worker 0 to 50 ms after the first step that it has answered. How many.
int KillWorkers(const std::string& endpoint, const GoesOn& goes_on) {
  Result<Client> client = Client::Connect(endpoint);
  if (!client.ok()) return 0;
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  Rng rng(1, "kills");
  ProcessView first;  // of this worker
  int kills = 0;
  while (goes_on(kills) && !deadline.expired()) {
    const ProcessView view = LookAt(*client, "worker-0");
    if (view.process_id == 0) continue;
    if (view.process_id != first.process_id) first = view;
    if (view.steps <= first.steps) continue;
    Pass(rng.Uniform(0, 50'000));
    if (kill(view.process_id, SIGKILL) != 0) continue;
    ++kills;
    while (LookAt(*client, "worker-0").process_id == view.process_id && !deadline.expired()) {
    }
  }
  return kills;
}

// Returns what was done.
std::string WalkWhileWorkersAreKilled(const GoesOn& goes_on, int least_kills) {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  REQUIRE(walk.environment().transport() == "door");
  int kills = 0;
  const double longest_wait =
      WalkBeside(walk, [&] { kills = KillWorkers(daemon.endpoint(), goes_on); });
  CHECK(kills >= least_kills);
  CHECK(LookAt(client, "worker-0").restarts >= static_cast<uint32_t>(kills));
  CHECK(walk.environment().transport() == "door");
  RequireUndisturbedBytes(walk);
  return fmt::format("{} workers were killed in {} steps, the longest of which took {:.2f} s",
                     kills, walk.FinishedSteps(), longest_wait);
}

TEST_CASE("Workers killed soon after their first step change no byte of a client at the door") {
  WalkWhileWorkersAreKilled(Times(20), 20);
}

TEST_CASE("A minute of killed workers changes no byte of a client at the door", "[.][long]") {
  WARN(WalkWhileWorkersAreKilled(Seconds(60), 20));
}

// --- Killed and stopped clients ---

// Returns what was done.
std::string WalkWhileClientsAreKilled(const GoesOn& goes_on) {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  const ProcessView before = LookAt(client, "worker-0");
  const Holdings held = HoldingsOf(before.process_id);
  REQUIRE(held.doors == 1);
  std::vector<std::string> last_lines;
  int kills = 0;
  WalkBeside(walk, [&] {
    Rng rng(2, "kills");
    for (; goes_on(kills); ++kills) {
      Walker walker(daemon.endpoint());
      // Some while they open their session, others while they step.
      if (kills % 3 != 0) walker.AwaitLines(2);
      Pass(rng.Uniform(5'000, 50'000));
      walker.End();
      if (const auto lines = walker.lines(); lines.size() > 1) last_lines.push_back(lines.back());
    }
  });
  CHECK(last_lines.size() > static_cast<size_t>(kills) / 2);
  UndisturbedWalker undisturbed;
  for (const std::string& line : last_lines) {
    CAPTURE(line);
    REQUIRE(undisturbed.Says(line));
  }
  RequireUnharmed(client, before, held);
  RequireUndisturbedBytes(walk);
  return fmt::format("{} clients were killed beside {} steps", kills, walk.FinishedSteps());
}

TEST_CASE("Clients killed at any moment leave nothing behind and touch no other client") {
  WalkWhileClientsAreKilled(Times(20));
}

TEST_CASE("A minute of killed clients leaves nothing behind", "[.][long]") {
  WARN(WalkWhileClientsAreKilled(Seconds(60)));
}

TEST_CASE("A client that stands still is served when it goes on, and others meanwhile") {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  Walker walker(daemon.endpoint());
  REQUIRE(walker.AwaitLines(5));
  walker.Signal(SIGSTOP);
  RequireOk(walk.RunTo(200));
  walker.Signal(SIGCONT);
  REQUIRE(walker.AwaitLines(walker.lines().size() + 100));
  walker.End();
  REQUIRE(walker.lines().front() == "door");
  UndisturbedWalker undisturbed;
  CHECK(undisturbed.Says(walker.lines().back()));
  CHECK(LookAt(client, "worker-0").restarts == 0);
  RequireUndisturbedBytes(walk);
}

TEST_CASE("A worker that stands still for a moment is waited for at the door") {
  PrivateDaemon daemon = StartDoorDaemon();
  Client client = Connect(daemon.endpoint());
  LaneWalk walk = OpenDoorWalk(client);
  const ProcessView worker = LookAt(client, "worker-0");
  WalkBeside(walk, [&] {
    for (int i = 0; i < 5; ++i) {
      kill(worker.process_id, SIGSTOP);
      Pass(200'000);  // far below the 2 s after which it is replaced
      kill(worker.process_id, SIGCONT);
      Pass(20'000);
    }
  });
  CHECK(LookAt(client, "worker-0").process_id == worker.process_id);
  CHECK(walk.environment().transport() == "door");
  RequireUndisturbedBytes(walk);
}

}  // namespace
}  // namespace b4mrl
