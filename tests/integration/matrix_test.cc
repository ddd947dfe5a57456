// Every environment x every perturbation, over real sockets: snapshots continue with equal bytes in
// another process, and results do not depend on workers, threads or clients. The short forms run
// always; those tagged [long] are the proofs.
#include <catch2/catch.hpp>
#include <thread>

#include "tests/data/temporary_folder.h"
#include "tests/integration/support/cells.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

// A daemon with a data folder of its own.
struct Daemon {
  Daemon(uint32_t workers, uint32_t threads)
      : daemon(StartDaemon({.data_folder = folder.path(),
                            .arguments = {"--workers", std::to_string(workers), "--threads",
                                          std::to_string(threads)}})) {}

  TemporaryFolder folder;
  PrivateDaemon daemon;
};

EnvironmentOptions Options(const Cell& cell, uint32_t lanes, uint64_t seed) {
  EnvironmentOptions options;
  options.simulator = cell.simulator;
  options.num_envs = lanes;
  options.seed = seed;
  options.observation_dtype = DType::kFloat64;
  options.deadline_ms = 120'000;
  return options;
}

// Actions of lanes that are at the given steps of the walk with `seed`.
std::vector<double> ActionsAt(const EnvironmentSpec& spec, uint64_t seed,
                              const std::vector<uint64_t>& steps) {
  std::vector<double> actions;
  for (const uint64_t step : steps) {
    const std::vector<double> action = WalkAction(spec, seed, step);
    actions.insert(actions.end(), action.begin(), action.end());
  }
  return actions;
}

struct SnapshotPlan {
  uint64_t snapshots;
  uint64_t stride;   // steps between two
  uint64_t horizon;  // steps that each is followed
};

// One lane walks in one daemon and is photographed on the way; another daemon goes on from all the
// snapshots at once.
void CheckSnapshots(Client& first, Client& second, const Cell& cell, const SnapshotPlan& plan) {
  constexpr uint64_t kSeed = 11;
  RemoteEnvironment walker = Take(first.Make(cell.environment, Options(cell, 1, kSeed)));
  RequireOk(walker.Reset().status());
  LaneStates states;
  std::vector<uint64_t> positions;
  std::vector<std::string> walk;
  for (uint64_t step = 0; step < plan.snapshots * plan.stride + plan.horizon; ++step) {
    if (step % plan.stride == 0 && positions.size() < plan.snapshots) {
      const LaneStates state = Take(walker.Snapshot());
      states.snapshot.insert(states.snapshot.end(), state.snapshot.begin(), state.snapshot.end());
      positions.push_back(step);
    }
    const auto outcome = Take(walker.Step(ActionsAt(walker.spec(), kSeed, {step})));
    walk.push_back(BytesOfStep(outcome, 0, walker.spec()));
  }
  states.lanes = positions.size();
  // Another seed: the snapshot brings its own.
  const auto lanes = static_cast<uint32_t>(positions.size());
  RemoteEnvironment followers = Take(second.Make(cell.environment, Options(cell, lanes, 999)));
  RequireOk(followers.Restore(states).status());
  for (uint64_t step = 0; step < plan.horizon; ++step) {
    const auto outcome = Take(followers.Step(ActionsAt(followers.spec(), kSeed, positions)));
    for (uint32_t lane = 0; lane < lanes; ++lane) {
      const bool equal = BytesOfStep(outcome, lane, followers.spec()) == walk[positions[lane]];
      if (!equal) FAIL(cell.Name() << ": lane " << lane << " differs at step " << step);
      ++positions[lane];
    }
  }
}

void CheckAllSnapshots(const SnapshotPlan& plan) {
  const Daemon one(1, 2), other(1, 2);
  Client first = Connect(one.daemon.endpoint());
  Client second = Connect(other.daemon.endpoint());
  for (const Cell& cell : Take(CellsOf(Take(first.Catalogue())))) {
    INFO(cell.Name());
    CheckSnapshots(first, second, cell, plan);
  }
}

TEST_CASE("Snapshots of every cell continue with equal bytes in another process") {
  CheckAllSnapshots({.snapshots = 3, .stride = 17, .horizon = 30});
}

TEST_CASE("A hundred snapshots of every cell continue for 1,000 steps", "[.][long]") {
  CheckAllSnapshots({.snapshots = 100, .stride = 10, .horizon = 1000});
}

// Lanes [first, first + count) of a walk, in a session of their own; bytes of lane i to
// (*bytes)[i]. Runs on any thread, so it reports instead of requiring.
Status Walk(const std::string& endpoint, const Cell& cell, uint64_t seed, uint32_t first,
            uint32_t count, uint64_t steps, std::vector<std::string>* bytes) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment,
                         client.Make(cell.environment, Options(cell, count, seed + first)));
  B4MRL_RETURN_IF_ERROR(environment.Reset().status());
  for (uint64_t step = 0; step < steps; ++step) {
    std::vector<double> actions;
    for (uint32_t lane = first; lane < first + count; ++lane) {
      const std::vector<double> action = WalkAction(environment.spec(), lane, step);
      actions.insert(actions.end(), action.begin(), action.end());
    }
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, environment.Step(actions));
    for (uint32_t lane = 0; lane < count; ++lane) {
      (*bytes)[first + lane] += BytesOfStep(outcome, lane, environment.spec());
    }
  }
  return Status();
}

std::vector<std::string> WalkAll(const Daemon& daemon, const Cell& cell, uint64_t seed,
                                 uint32_t lanes, uint32_t clients, uint64_t steps) {
  std::vector<std::string> bytes(lanes);
  std::vector<Status> statuses(clients);
  std::vector<std::thread> threads;
  const uint32_t count = lanes / clients;
  for (uint32_t i = 0; i < clients; ++i) {
    threads.emplace_back([&, i] {
      statuses[i] = Walk(daemon.daemon.endpoint(), cell, seed, i * count, count, steps, &bytes);
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : statuses) RequireOk(status);
  return bytes;
}

void CheckDeterminism(uint32_t lanes, uint64_t steps) {
  constexpr uint64_t kSeed = 30;
  const Daemon alone(1, 1), many(2, 3);
  Client client = Take(Client::Connect(alone.daemon.endpoint()));
  for (const Cell& cell : Take(CellsOf(Take(client.Catalogue())))) {
    INFO(cell.Name());
    const auto reference = WalkAll(alone, cell, kSeed, lanes, 1, steps);
    const auto shared_out = WalkAll(many, cell, kSeed, lanes, lanes / 2, steps);
    const auto other_seed = WalkAll(alone, cell, kSeed + lanes, lanes, 1, steps);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
      CAPTURE(lane);
      REQUIRE((reference[lane] == shared_out[lane]));
      REQUIRE((reference[lane] != other_seed[lane]));
    }
  }
}

TEST_CASE("Equal seeds give equal bytes in every cell, whatever the workers, threads, clients") {
  CheckDeterminism(4, 15);
}

TEST_CASE("Equal seeds give equal bytes in every cell over whole episodes", "[.][long]") {
  CheckDeterminism(8, 1200);
}

}  // namespace
}  // namespace b4mrl
