// Rows of Query a second, against bare mj_step from the same states on all cores.
//
#include <deque>
#include <vector>

#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/bare_physics.h"
#include "benchmarks/performance/support/daemon.h"
#include "benchmarks/performance/support/recorded_rows.h"
#include "proto/base/clock.h"

namespace b4mrl::perf {
namespace {

constexpr size_t kRowsPerRequest = 500;
constexpr size_t kRequestsInFlight = 8;
constexpr size_t kCheetahJoints = 9;  // nq = nv

// The states that observations describe: qpos[1..8] and qvel; qpos[0] is 0.
std::vector<PhysicsRow> AsPhysicsRows(const RecordedRows& recorded) {
  std::vector<PhysicsRow> rows(recorded.rows());
  for (size_t i = 0; i < rows.size(); ++i) {
    const float* observation = &recorded.observations[i * kCheetahObservationSize];
    const float* action = &recorded.actions[i * kCheetahActionSize];
    rows[i].position.assign(1, 0.0);
    rows[i].position.insert(rows[i].position.end(), observation, observation + kCheetahJoints - 1);
    rows[i].velocity.assign(observation + kCheetahJoints - 1,
                            observation + kCheetahObservationSize);
    rows[i].control.assign(action, action + kCheetahActionSize);
  }
  return rows;
}

class QueryLoop {
 public:
  QueryLoop(RemoteEnvironment environment, const RecordedRows& recorded)
      : environment_(std::move(environment)),
        recorded_(recorded),
        next_observations_(kRowsPerRequest * kCheetahObservationSize),
        rewards_(kRowsPerRequest),
        terminated_(kRowsPerRequest),
        valid_(kRowsPerRequest) {}

  // Sends queries for about `seconds`; returns the rows a second.
  Result<double> Rate(double seconds) {
    const Clock::time_point start = Clock::now();
    for (size_t i = 0; i < kRequestsInFlight; ++i) B4MRL_RETURN_IF_ERROR(Send());
    uint64_t rows = 0;
    double elapsed = 0;
    while (!in_flight_.empty()) {
      B4MRL_RETURN_IF_ERROR(environment_.ReceiveQuery(
          in_flight_.front(), {next_observations_, rewards_, terminated_, valid_}));
      in_flight_.pop_front();
      for (const uint8_t valid : valid_) {
        if (valid == 0) return Status(StatusCode::kInternal, "a recorded row came back invalid");
      }
      rows += kRowsPerRequest;
      elapsed = SecondsSince(start);
      if (elapsed < seconds) B4MRL_RETURN_IF_ERROR(Send());
    }
    return static_cast<double>(rows) / elapsed;
  }

 private:
  Status Send() {
    const std::span<const float> observations(
        &recorded_.observations[next_row_ * kCheetahObservationSize],
        kRowsPerRequest * kCheetahObservationSize);
    const std::span<const float> actions(&recorded_.actions[next_row_ * kCheetahActionSize],
                                         kRowsPerRequest * kCheetahActionSize);
    B4MRL_ASSIGN_OR_RETURN(const uint64_t id,
                           environment_.SendQuery(observations, actions, 0, 0, next_row_));
    in_flight_.push_back(id);
    next_row_ = (next_row_ + kRowsPerRequest) % recorded_.rows();
    return Status();
  }

  RemoteEnvironment environment_;
  const RecordedRows& recorded_;
  std::deque<uint64_t> in_flight_;
  size_t next_row_ = 0;
  std::vector<float> next_observations_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_;
  std::vector<uint8_t> valid_;
};

static_assert(kRecordedRows % kRowsPerRequest == 0, "requests wrap at the end");

}  // namespace

Status MeasureQuery(const Options& options, Reporter& reporter) {
  B4MRL_ASSIGN_OR_RETURN(Daemon daemon, Daemon::Open(options, {}));
  B4MRL_ASSIGN_OR_RETURN(const RecordedRows recorded, RecordRows(daemon.client(), options));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment,
                         daemon.client().Make("HalfCheetah", {.num_envs = 0}));
  QueryLoop loop(std::move(environment), recorded);
  B4MRL_ASSIGN_OR_RETURN(const auto bare, BarePhysics::Load(HalfCheetahTask()));
  const std::vector<PhysicsRow> rows = AsPhysicsRows(recorded);
  B4MRL_ASSIGN_OR_RETURN(
      const Medians medians,
      MeasureInTurns(
          options.turns, [&] { return loop.Rate(options.seconds); },
          [&]() -> Result<double> { return bare->QueryRate(rows, options.seconds); }));
  reporter.Report({"query-HalfCheetah", medians.value, "1/s", medians.limit,
                   "bare mj_step from the same states, warm start 0, one pinned thread a core",
                   0.85, false});
  return Status();
}

}  // namespace b4mrl::perf
