#include "tests/integration/support/worker_load.h"

#include <poll.h>

#include <algorithm>
#include <deque>
#include <numeric>

#include "proto/base/clock.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

constexpr uint32_t kLanesInFlight = 512;
constexpr size_t kRows = 4096;
constexpr size_t kSmallRows = 64;

class Steps {
 public:
  explicit Steps(const std::string& endpoint)
      : client_(Connect(endpoint)),
        session_(Take(client_.Make("Humanoid", {.num_envs = 2 * kLanesInFlight, .seed = 1}))),
        actions_(kLanesInFlight * session_.spec().action.size(), 0.1f) {
    RequireOk(session_.Reset().status());
    for (std::vector<uint32_t>& lanes : lanes_) lanes.resize(kLanesInFlight);
    std::iota(lanes_[0].begin(), lanes_[0].end(), 0);
    std::iota(lanes_[1].begin(), lanes_[1].end(), kLanesInFlight);
    for (int half : {0, 1}) RequireOk(Send(half));
  }
  Status Advance() {
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, session_.Receive());
    return Send(outcome.request_id == ids_[0] ? 0 : 1);
  }

 private:
  Status Send(int half) {
    B4MRL_ASSIGN_OR_RETURN(ids_[half],
                           session_.Send(std::span<const float>(actions_), lanes_[half]));
    return Status();
  }

  Client client_;
  RemoteEnvironment session_;
  std::vector<float> actions_;
  std::vector<uint32_t> lanes_[2];
  uint64_t ids_[2] = {0, 0};
};

class Queries {
 public:
  Queries(const std::string& endpoint, int in_flight, int64_t deadline_ms)
      : client_(Connect(endpoint)),
        session_(Take(client_.Make("Humanoid", {.num_envs = 0, .deadline_ms = deadline_ms}))),
        observations_(kRows * session_.spec().observation.size()),
        actions_(kRows * session_.spec().action.size()),
        next_observations_(observations_.size()),
        rewards_(kRows),
        terminated_(kRows),
        valid_(kRows) {
    for (int i = 0; i < in_flight; ++i) RequireOk(Send());
  }
  Status Advance() {
    const Status status = session_.ReceiveQuery(
        ids_.front(), QueryOutput{next_observations_, rewards_, terminated_, valid_});
    // There is more to do than fits into a deadline.
    if (!status.ok() && status.code() != StatusCode::kDeadlineExceeded) return status;
    ids_.pop_front();
    return Send();
  }

 private:
  Status Send() {
    B4MRL_ASSIGN_OR_RETURN(const uint64_t id,
                           session_.SendQuery(std::span<const float>(observations_),
                                              std::span<const float>(actions_), 0, 0, 0));
    ids_.push_back(id);
    return Status();
  }

  Client client_;
  RemoteEnvironment session_;
  std::vector<float> observations_, actions_, next_observations_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_, valid_;
  std::deque<uint64_t> ids_;
};

}  // namespace

Load::Load(std::function<Status()> advance)
    : thread_([this, advance = std::move(advance)] {
        for (; !stop_.load() && status_.ok(); ++calls_) status_ = advance();
      }) {}

Status Load::Stop() {
  Halt();
  if (thread_.joinable()) thread_.join();
  return status_;
}

double Load::RateFor(double seconds) const {
  const uint64_t before = calls_.load();
  const Clock::time_point start = Clock::now();
  while (SecondsSince(start) < seconds) poll(nullptr, 0, 10);
  return (calls_.load() - before) / SecondsSince(start);
}

std::unique_ptr<Load> StepHumanoids(const std::string& endpoint) {
  auto steps = std::make_shared<Steps>(endpoint);
  return std::make_unique<Load>([steps] { return steps->Advance(); });
}

std::unique_ptr<Load> AskCostlyRows(const std::string& endpoint, int in_flight,
                                    int64_t deadline_ms) {
  auto queries = std::make_shared<Queries>(endpoint, in_flight, deadline_ms);
  return std::make_unique<Load>([queries] { return queries->Advance(); });
}

Pace StepFor(RemoteEnvironment& session, double seconds) {
  const std::vector<float> action(session.spec().action.size(), 0.1f);
  std::vector<double> times;
  const Clock::time_point start = Clock::now();
  while (SecondsSince(start) < seconds) {
    const Clock::time_point sent = Clock::now();
    RequireOk(session.Step(std::span<const float>(action)).status());
    times.push_back(1e3 * SecondsSince(sent));
  }
  const double rate = times.size() / SecondsSince(start);
  const auto place = times.begin() + static_cast<int64_t>(times.size() * 99 / 100);
  std::nth_element(times.begin(), place, times.end());
  return {rate, *place};
}

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<int64_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double MedianMs(int times, const std::function<void()>& call) {
  std::vector<double> durations;
  for (int i = 0; i < times; ++i) {
    const Clock::time_point start = Clock::now();
    call();
    durations.push_back(1e3 * SecondsSince(start));
  }
  return Median(std::move(durations));
}

SmallQueries::SmallQueries(Client& client)
    : session_(Take(client.Make("HalfCheetah", {.num_envs = 0}))),
      observations_(kSmallRows * session_.spec().observation.size(), 0.1f),
      actions_(kSmallRows * session_.spec().action.size(), 0.1f),
      next_observations_(observations_.size()),
      rewards_(kSmallRows),
      terminated_(kSmallRows),
      valid_(kSmallRows) {}

double SmallQueries::MedianMs(int times) {
  return b4mrl::MedianMs(times, [this] {
    RequireOk(session_.Query(std::span<const float>(observations_),
                             std::span<const float>(actions_),
                             {next_observations_, rewards_, terminated_, valid_}));
  });
}

}  // namespace b4mrl
