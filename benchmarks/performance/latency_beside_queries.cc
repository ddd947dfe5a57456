// The 99th percentile of a one-lane client's step times while another client keeps every core busy
// with large queries, against the 99th percentile without the other client.
#include <algorithm>
#include <atomic>
#include <future>
#include <span>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/single_lane.h"

namespace b4mrl::perf {
namespace {

constexpr int kStepsPerTurn = 2000;
constexpr size_t kRowsPerQuery = 50'000;

// Sends queries with these actions, one after another, until `stop`; returns the first error.
Status Ask(RemoteEnvironment& environment, std::span<const float> actions,
           const std::atomic<bool>& stop) {
  const std::vector<float> observations(kRowsPerQuery * kCheetahObservationSize);
  std::vector<float> next_observations(observations.size());
  std::vector<double> rewards(kRowsPerQuery);
  std::vector<uint8_t> terminated(kRowsPerQuery), valid(kRowsPerQuery);
  while (!stop) {
    B4MRL_RETURN_IF_ERROR(
        environment.Query(observations, actions, {next_observations, rewards, terminated, valid}));
  }
  return Status();
}

// The 99th percentile of the step times, in microseconds.
Result<double> Percentile99(SingleLane& lane) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<double> times, lane.StepTimes(kStepsPerTurn));
  const auto place = times.begin() + kStepsPerTurn * 99 / 100;
  std::nth_element(times.begin(), place, times.end());
  return *place;
}

}  // namespace

Status MeasureLatencyBesideQueries(const Options& options, Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {}));
  B4MRL_ASSIGN_OR_RETURN(SingleLane lane, SingleLane::Open(daemon.client()));
  const std::vector<float> actions = RandomActions(kRowsPerQuery);
  const auto beside_queries = [&]() -> Result<double> {
    B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(daemon.endpoint()));
    B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment,
                           client.Make("HalfCheetah", {.num_envs = 0}));
    std::atomic<bool> stop = false;
    auto load = std::async(std::launch::async, [&] { return Ask(environment, actions, stop); });
    const Result<double> time = Percentile99(lane);
    stop = true;
    B4MRL_RETURN_IF_ERROR(load.get());
    return time;
  };
  const auto alone = [&] { return Percentile99(lane); };
  B4MRL_ASSIGN_OR_RETURN(const Medians medians,
                         MeasureInTurns(options.turns, beside_queries, alone));
  reporter.Report({"latency-beside-queries", medians.value, "us", medians.limit,
                   "the same step alone, p99", 3, true});
  return Status();
}

}  // namespace b4mrl::perf
