#include "algorithms/experience/training_simulator.h"

#include <fmt/format.h>

#include <utility>

#include "client/client.h"

namespace b4mrl {

Result<RemoteEnvironment> OpenTrainingSimulator(const LearnerContext& context, uint32_t lanes) {
  EnvironmentOptions options;
  options.simulator = context.simulator;
  options.num_envs = lanes;
  options.seed = context.seed;  // the first Reset then gives every lane its own seed
  options.autoreset_mode = AutoresetMode::kSameStep;
  options.deadline_ms = kLearnerDeadlineMs;
  options.ledger = context.ledger;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session,
                         context.client->Make(context.environment.name, options));
  const EnvironmentSpec& spec = session.spec();
  if (spec.observation.size() != context.environment.observation.size() ||
      spec.action.size() != context.environment.action.size()) {
    return Status(
        StatusCode::kInvalidArgument,
        fmt::format("the simulator has {} observation and {} action values, {} has {} and {}",
                    spec.observation.size(), spec.action.size(), context.environment.name,
                    context.environment.observation.size(), context.environment.action.size()));
  }
  return session;
}

bool IsDueAgain(const Client& client, Clock::time_point asked) {
  const uint64_t lease_ms = client.hello().limits().session_lease_ms();
  // Daemons of older versions do not say how long they wait.
  return lease_ms > 0 && SecondsSince(asked) * 1000 > static_cast<double>(lease_ms) / 3;
}

}  // namespace b4mrl
