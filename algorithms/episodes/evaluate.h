// Scores of agents: deterministic episodes on one environment, by client/evaluation.h.
//
// Actions come from the fixed-order inference, so returns have equal bits for any number of workers
// and threads and on any x86-64 processor with AVX2 and FMA. For a policy with a history, the
// evaluator stacks each lane's last observations. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/policy/agent_policy.h"
#include "client/client.h"
#include "client/evaluation.h"
#include "client/remote_environment.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Evaluator {
 public:
  // Checks with the daemon that it can open a session with these settings. `client` must outlive
  // the evaluator. Errors: those of client/client.h.
  static Result<Evaluator> Open(Client& client, const std::string& environment,
                                const std::vector<NamedArgument>& perturbations, uint32_t episodes,
                                uint64_t seed = 0);

  // From now on the ledger of this number counts the episodes (Client::OpenLedger); 0: none.
  void set_ledger(uint64_t ledger) { options_.ledger = ledger; }

  // Runs the episodes in a new session, since hours may pass between two evaluations and the lease
  // of an idle session ends. kInvalidArgument when the policy's sizes do not fit the environment.
  Result<EvaluationResult> Run(const AgentPolicy& policy, const EpisodeWatcher& watch = nullptr);

 private:
  Evaluator(Client* client, std::string environment, EnvironmentOptions options, uint64_t seed)
      : client_(client),
        environment_(std::move(environment)),
        options_(std::move(options)),
        seed_(seed) {}

  Client* client_;
  std::string environment_;
  EnvironmentOptions options_;
  uint64_t seed_;
};

// Write and read one evaluation in a checkpoint, under "<name>/".
void SaveEvaluation(CheckpointWriter& writer, const std::string& name,
                    const EvaluationResult& result);
EvaluationResult LoadEvaluation(CheckpointReader& reader, const std::string& name);

}  // namespace b4mrl
