#include "algorithms/experience/training_simulator.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>

#include "client/client.h"
#include "proto/base/role_seed.h"

namespace b4mrl {

Result<RemoteEnvironment> OpenTrainingSimulator(const LearnerContext& context, uint32_t lanes) {
  EnvironmentOptions options;
  options.simulator = context.simulator;
  options.num_envs = lanes;
  options.seed = SessionSeed(context.seed, std::max(lanes, 1u));
  options.autoreset_mode = AutoresetMode::kSameStep;
  options.deadline_ms = kLearnerDeadlineMs;
  options.ledger = context.ledger;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session,
                         context.client->Make(context.environment.name, options));
  const EnvironmentSpec& spec = session.spec();
  B4MRL_RETURN_IF_ERROR(
      context.environment.CheckSizes("the simulator", spec.observation.size(), spec.action.size()));
  return session;
}

Result<StepOutcome> UntilTaken(const std::function<Result<StepOutcome>()>& step,
                               const std::atomic<bool>& stop) {
  constexpr int kPauseMs = 10;
  const Deadline deadline = Deadline::AfterMs(kLearnerDeadlineMs);
  while (true) {
    Result<StepOutcome> outcome = step();
    const StatusCode code = outcome.status().code();
    const bool may_pass = code == StatusCode::kBusy || code == StatusCode::kLimitExceeded;
    if (!may_pass || deadline.expired()) return outcome;
    if (stop) {
      return Status(
          StatusCode::kUnavailable,
          fmt::format("told to stop while a step was refused: {}", outcome.status().message()));
    }
    poll(nullptr, 0, kPauseMs);
  }
}

bool IsDueAgain(const Client& client, Clock::time_point asked) {
  const uint64_t lease_ms = client.hello().limits().session_lease_ms();
  // Daemons of older versions do not say how long they wait.
  return lease_ms > 0 && SecondsSince(asked) * 1000 > static_cast<double>(lease_ms) / 3;
}

}  // namespace b4mrl
