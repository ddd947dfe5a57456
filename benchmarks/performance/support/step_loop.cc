#include "benchmarks/performance/support/step_loop.h"

#include <numeric>

#include "proto/base/clock.h"

namespace b4mrl::perf {

Result<StepLoop> StepLoop::Open(Client& client, const std::string& environment,
                                const std::vector<NamedArgument>& simulator, uint32_t requests) {
  EnvironmentOptions options;
  options.simulator = simulator;
  options.num_envs = kLanes;
  options.seed = 0;
  options.autoreset_mode = AutoresetMode::kSameStep;  // a reset takes no step, as in the limit
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment opened, client.Make(environment, options));
  B4MRL_RETURN_IF_ERROR(opened.Reset().status());
  return StepLoop(std::move(opened), requests);
}

StepLoop::StepLoop(RemoteEnvironment environment, uint32_t requests)
    : environment_(std::move(environment)), lanes_(kLanes), requests_(requests) {
  std::iota(lanes_.begin(), lanes_.end(), 0u);
}

Result<double> StepLoop::Rate(double seconds) {
  const Clock::time_point start = Clock::now();
  for (uint32_t group = 0; group < requests_; ++group) B4MRL_RETURN_IF_ERROR(Send(group));
  uint64_t steps = 0;
  double elapsed = 0;
  while (environment_.in_flight() > 0) {
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, environment_.Receive());
    const auto entry = group_of_.find(outcome.request_id);
    const uint32_t group = entry->second;
    group_of_.erase(entry);
    steps += kLanes / requests_;
    elapsed = SecondsSince(start);
    if (elapsed < seconds) B4MRL_RETURN_IF_ERROR(Send(group));
  }
  return static_cast<double>(steps) / elapsed;
}

Status StepLoop::Send(uint32_t group) {
  const uint32_t share = kLanes / requests_;
  const std::span<const uint32_t> lanes(&lanes_[group * share], share);
  const size_t count = share * action_size();
  const std::span<const float> actions = std::span<const float>(actions_).subspan(next_, count);
  next_ = (next_ + count) % actions_.size();
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, environment_.Send(actions, lanes));
  group_of_[id] = group;
  return Status();
}

}  // namespace b4mrl::perf
