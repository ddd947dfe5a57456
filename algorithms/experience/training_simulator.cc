#include "algorithms/experience/training_simulator.h"

#include <fmt/format.h>

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

bool IsDueAgain(const Client& client, Clock::time_point asked) {
  const uint64_t lease_ms = client.hello().limits().session_lease_ms();
  // Daemons of older versions do not say how long they wait.
  return lease_ms > 0 && SecondsSince(asked) * 1000 > static_cast<double>(lease_ms) / 3;
}

}  // namespace b4mrl
