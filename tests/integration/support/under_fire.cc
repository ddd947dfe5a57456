#include "tests/integration/support/under_fire.h"

#include <signal.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "tests/results.h"

namespace b4mrl {
namespace {

// False if it takes too long.
bool Harass(const std::string& endpoint, const Fire& fire) {
  Result<Client> client = Client::Connect(endpoint);
  if (!client.ok()) return false;
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  pid_t last = 0;
  uint64_t last_steps = 0;
  for (int i = 0; i < fire.times;) {
    if (deadline.expired()) return false;
    const ProcessView view = LookAt(*client, fire.role);
    if (view.process_id == 0 || view.process_id == last ||
        view.steps < last_steps + fire.steps_between) {
      continue;
    }
    if (kill(view.process_id, fire.signal) != 0) continue;
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
    return {static_cast<pid_t>(worker.process_id()), worker.steps(), worker.restarts(),
            worker.requests()};
  }
  return {};
}

ProcessView AwaitRequest(Client& client, const std::string& role, const ProcessView& before) {
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  ProcessView view = LookAt(client, role);
  while (view.requests <= before.requests && !deadline.expired()) view = LookAt(client, role);
  return view;
}

void AdvanceUnderFire(const std::string& endpoint, const Fire& fire,
                      const std::function<Status()>& advance) {
  std::atomic<bool> done{false};
  bool all_sent = false;
  std::thread gun([&] {
    all_sent = Harass(endpoint, fire);
    done = true;
  });
  Status status;
  while (!done && status.ok()) status = advance();
  gun.join();
  RequireOk(status);
  REQUIRE(all_sent);
}

void WalkUnderFire(LaneWalk& walk, const std::string& endpoint, const Fire& fire) {
  AdvanceUnderFire(endpoint, fire, [&walk] { return walk.Advance(); });
  RequireOk(walk.Drain());
}

}  // namespace b4mrl
