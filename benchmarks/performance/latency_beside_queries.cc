// The 99th percentile of a one-lane client's step times while another client keeps every core busy
// with large queries, against the 99th percentile without the other client.
#include <algorithm>
#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/single_lane.h"

namespace b4mrl::perf {
namespace {

constexpr int kStepsPerTurn = 2000;
constexpr size_t kRowsPerQuery = 50'000;

// A client on a thread of its own that sends queries until the object is destroyed.
class QueryLoad {
 public:
  // Returns when the client is about to send its first query.
  explicit QueryLoad(const std::string& endpoint) : thread_([this, endpoint] { Run(endpoint); }) {
    started_.wait(false);
  }
  ~QueryLoad() { (void)Stop(); }

  // Ends the queries, after the query that is under way; returns the first error.
  Status Stop() {
    stop_.store(true);
    if (thread_.joinable()) thread_.join();
    return status_;
  }

 private:
  void Run(const std::string& endpoint) {
    status_ = Ask(endpoint);
    Started();  // so that the constructor returns after an early failure
  }
  void Started() {
    started_.store(true);
    started_.notify_one();
  }
  Status Ask(const std::string& endpoint);

  std::atomic<bool> stop_{false};
  std::atomic<bool> started_{false};
  Status status_;
  std::thread thread_;  // the last member: it uses the others
};

Status QueryLoad::Ask(const std::string& endpoint) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  EnvironmentOptions queries_alone;
  queries_alone.num_envs = 0;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment, client.Make("HalfCheetah", queries_alone));
  const std::vector<float> observations(kRowsPerQuery * kCheetahObservationSize);
  const std::vector<float> actions = RandomActions(kRowsPerQuery);
  std::vector<float> next_observations(observations.size());
  std::vector<double> rewards(kRowsPerQuery);
  std::vector<uint8_t> terminated(kRowsPerQuery), valid(kRowsPerQuery);
  while (!stop_.load()) {
    Started();
    B4MRL_RETURN_IF_ERROR(environment.Query(std::span<const float>(observations),
                                            std::span<const float>(actions),
                                            {next_observations, rewards, terminated, valid}));
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
  const auto beside_queries = [&]() -> Result<double> {
    QueryLoad load(daemon.endpoint());
    Result<double> time = Percentile99(lane);
    B4MRL_RETURN_IF_ERROR(load.Stop());
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
