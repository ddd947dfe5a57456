// Steps a second from Python, beside those of Gymnasium and EnvPool in the same process, and of the
// C++ client.
#include <fmt/format.h>

#include <cstdio>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/python_loops.h"
#include "benchmarks/performance/support/step_loop.h"

namespace b4mrl::perf {
namespace {

// A loop of b4mrl's Python client and the loop of a peer that it is compared with.
struct Comparison {
  const char* name;
  const char* own;
  const char* peer;
  const char* limit_name;
  double target;  // 0: none
};

constexpr Comparison kComparisons[] = {
    {"python-single", "b4mrl-single", "gymnasium-single", "Gymnasium in process", 0.6},
    {"python-single-envpool", "b4mrl-single", "envpool-single", "EnvPool, 1 environment", 3},
    {"python-humanoid", "b4mrl-humanoid", "gymnasium-humanoid", "Gymnasium in process", 0.8},
    {"python-vec8-sync", "b4mrl-8", "gymnasium-sync-8", "Gymnasium's SyncVectorEnv", 1.2},
    {"python-vec8-async", "b4mrl-8", "gymnasium-async-8", "Gymnasium's AsyncVectorEnv", 4},
    {"python-vec8-envpool", "b4mrl-8", "envpool-8", "EnvPool, 8 environments", 0},
    {"python-vec64-envpool", "b4mrl-64", "envpool-64", "EnvPool, 64 environments", 0},
    {"python-halves-envpool", "b4mrl-halves", "envpool-halves",
     "EnvPool, 64 environments, 32 a batch", 0},
};

// make_vec(64).step beside the C++ client's step of 64 lanes, one request in flight.
Status MeasureBesideCpp(const Options& options, Client& client, PythonLoops& python,
                        Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(StepLoop loop, StepLoop::Open(client, "HalfCheetah", {}, 1));
  loop.UseActions(RandomActions(64 * StepLoop::kLanes));
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns, [&] { return python.Rate("b4mrl-64", options.seconds); },
          [&] { return loop.Rate(options.seconds); }));
  reporter.Report({"python-vec64", medians.value, "1/s", medians.limit,
                   "the C++ client's step of 64 lanes, one request in flight", 0.85, false});
  return Status();
}

}  // namespace

Status MeasurePython(const Options& options, Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {.transport = Transport::kDoor}));
  B4MRL_ASSIGN_OR_RETURN(const auto python, PythonLoops::Start(daemon.endpoint()));
  for (const Comparison& it : kComparisons) {
    if (!python->Has(it.peer)) {
      fmt::print(
          stderr, "b4mrl perf python: {} is left out: this Python lacks {}\n", it.name,
          std::string_view(it.peer).starts_with("envpool") ? "envpool" : "gymnasium[mujoco]");
      continue;
    }
    B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                           MeasureInTurns(
                               options.turns, [&] { return python->Rate(it.own, options.seconds); },
                               [&] { return python->Rate(it.peer, options.seconds); }));
    reporter.Report(
        {it.name, medians.value, "1/s", medians.limit, it.limit_name, it.target, false});
  }
  return MeasureBesideCpp(options, daemon.client(), *python, reporter);
}

}  // namespace b4mrl::perf
