// Scores: deterministic episodes of a policy on one environment, all at once as lanes of one
// session.
//
// Episode i of every evaluation starts from the seed RoleSeed(seed, "evaluation", i): the same for
// all runs and agents, and apart from every training seed. Actions come from the fixed-order
// inference, so returns have equal bits for any number of workers and threads and on any x86-64
// processor with AVX2 and FMA. For a policy with a history, the evaluator stacks each lane's last
// observations. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/base/checkpoint.h"
#include "algorithms/policy/agent_policy.h"
#include "client/client.h"
#include "client/remote_environment.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct EvaluationResult {
  std::vector<double> returns;  // undiscounted return of each episode
  std::vector<uint32_t> lengths;
  // Episodes that the daemon or the physics engine gave up (StepOutcome::given_up). They count in
  // the mean with their return until then.
  uint32_t given_up = 0;
  double mean_return = 0;
  double std_return = 0;        // population standard deviation over episodes
  std::optional<double> score;  // D4RL's normalised score of mean_return; needs reference returns
};

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
  // `watch`, if given, is called with the session after the reset and after each step of lane 0
  // until that lane's episode has ended; an error that it returns ends the evaluation.
  using Watcher = std::function<Status(RemoteEnvironment& session)>;
  Result<EvaluationResult> Run(const AgentPolicy& policy, const Watcher& watch = nullptr);

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
