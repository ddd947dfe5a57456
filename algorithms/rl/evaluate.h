// Scores: deterministic episodes of a policy on one environment, all at once as lanes of one
// session.
//
// Episode i of every evaluation starts from the seed RoleSeed(seed, "evaluation", i): the same for
// all runs and agents, and apart from every training seed. Actions come from the fixed-order
// inference, so returns have equal bits for any number of workers and threads and on any x86-64
// processor with AVX2 and FMA. A policy that needs a history gets it stacked here. Thread rule: one
// thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/nn/checkpoint.h"
#include "algorithms/rl/agent_policy.h"
#include "client/client.h"
#include "client/remote_environment.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct EvaluationResult {
  std::vector<double> returns;  // undiscounted, one an episode
  std::vector<uint32_t> lengths;
  double mean_return = 0;
  double std_return = 0;        // over episodes, population
  std::optional<double> score;  // of the mean, normalised as D4RL; none without reference returns
};

class Evaluator {
 public:
  // Opens a session of `episodes` lanes. Errors: the daemon's, as client/client.h.
  static Result<Evaluator> Open(Client& client, const std::string& environment,
                                const std::vector<NamedArgument>& perturbations, uint32_t episodes,
                                uint64_t seed = 0);

  // kInvalidArgument when the policy's sizes do not fit the environment.
  Result<EvaluationResult> Run(const AgentPolicy& policy);

  const EnvironmentSpec& environment() const { return session_.spec(); }

 private:
  Evaluator(RemoteEnvironment session, uint32_t episodes, uint64_t seed)
      : session_(std::move(session)), episodes_(episodes), seed_(seed) {}
  Status CheckSizes(const AgentPolicy& policy) const;

  RemoteEnvironment session_;
  uint32_t episodes_;
  uint64_t seed_;
};

// One result in a checkpoint, under "<name>/".
void SaveEvaluation(CheckpointWriter& writer, const std::string& name,
                    const EvaluationResult& result);
EvaluationResult LoadEvaluation(CheckpointReader& reader, const std::string& name);

}  // namespace b4mrl
