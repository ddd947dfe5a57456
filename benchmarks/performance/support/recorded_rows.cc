#include "benchmarks/performance/support/recorded_rows.h"

#include <string>

#include "algorithms/policy/agent_policy.h"
#include "data/d4rl/agent_file.h"
#include "proto/base/folders.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

constexpr uint32_t kRecordedLanes = 16;
constexpr int kRecordedSteps = kRecordedRows / kRecordedLanes;

}  // namespace

Result<RecordedRows> RecordRows(Client& client, const Options& options) {
  const std::string agent_file =
      options.agent_file.empty()
          ? SharedFolder("agents", B4MRL_AGENTS_FOLDER) + "/halfcheetah-medium.h5"
          : options.agent_file;
  B4MRL_ASSIGN_OR_RETURN(const Agent agent, ReadAgent(agent_file));
  B4MRL_ASSIGN_OR_RETURN(const AgentPolicy policy, AgentPolicy::Create(agent));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment,
                         client.Make("HalfCheetah", {.num_envs = kRecordedLanes, .seed = 0}));
  B4MRL_ASSIGN_OR_RETURN(StepOutcome outcome, environment.Reset());
  MatrixBuffer<float> noise(kCheetahActionSize, kRecordedLanes);
  MatrixBuffer<float> actions(kCheetahActionSize, kRecordedLanes);
  std::vector<float> log_probs(kRecordedLanes);
  Rng rng(0, "perf-policy");
  RecordedRows recorded;
  for (int step = 0; step < kRecordedSteps; ++step) {
    const std::span<const float> observations = outcome.observations.As<float>();
    rng.FillNormal({noise.view().data, kCheetahActionSize * kRecordedLanes});
    policy.Sample({observations.data(), int{kCheetahObservationSize}, int{kRecordedLanes}},
                  noise.view(), actions.view(), log_probs);
    const std::span<const float> row(actions.view().data, kCheetahActionSize * kRecordedLanes);
    recorded.observations.insert(recorded.observations.end(), observations.begin(),
                                 observations.end());
    recorded.actions.insert(recorded.actions.end(), row.begin(), row.end());
    B4MRL_ASSIGN_OR_RETURN(outcome, environment.Step(row));
  }
  return recorded;
}

}  // namespace b4mrl::perf
