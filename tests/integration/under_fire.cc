#include "tests/integration/under_fire.h"

#include <signal.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

namespace b4mrl {
namespace {

// False if it takes too long.
bool Harass(const std::string& endpoint, const std::string& role, int signal, int times,
            uint64_t steps_between) {
  Result<Client> client = Client::Connect(endpoint);
  if (!client.ok()) return false;
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  pid_t last = 0;
  uint64_t last_steps = 0;
  for (int i = 0; i < times;) {
    if (deadline.expired()) return false;
    const ProcessView view = LookAt(*client, role);
    if (view.process_id == 0 || view.process_id == last ||
        view.steps < last_steps + steps_between) {
      continue;
    }
    if (kill(view.process_id, signal) != 0) continue;
    last = view.process_id;
    last_steps = view.steps;
    ++i;
  }
  return true;
}

}  // namespace

ProcessView LookAt(Client& client, const std::string& role) {
  const Result<pb::ServerStatusReply> status = client.ServerStatus();
  if (!status.ok()) return {};
  for (const pb::WorkerStatus& worker : status->workers()) {
    if (worker.role() != role) continue;
    return {static_cast<pid_t>(worker.process_id()), worker.steps(), worker.restarts()};
  }
  return {};
}

void WalkUnderFire(LaneWalk& walk, const std::string& endpoint, const std::string& role, int signal,
                   int times, uint64_t steps_between) {
  std::atomic<bool> done{false};
  bool all_sent = false;
  std::thread gun([&] {
    all_sent = Harass(endpoint, role, signal, times, steps_between);
    done = true;
  });
  Status status;
  while (!done && status.ok()) status = walk.Advance();
  gun.join();
  if (status.ok()) status = walk.Drain();
  INFO(status.ToString());
  REQUIRE(status.ok());
  REQUIRE(all_sent);
}

}  // namespace b4mrl
