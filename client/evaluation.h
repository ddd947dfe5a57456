// Evaluations: whole episodes of a policy, all at once as lanes of one session. The one loop in C++
// for it: `b4mrl evaluate`, training runs and RemoteBenchmark::Evaluate score policies by it.
//
// Episode i starts from the seed RoleSeed(seed, "evaluation", i): the same for all policies, and
// apart from every training seed. Returns have equal bits for any number of workers and threads if
// the policy's actions have. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "client/remote_environment.h"
#include "proto/base/status.h"

namespace b4mrl {

struct EvaluationResult {
  std::vector<double> returns;    // undiscounted return of each episode
  std::vector<uint32_t> lengths;  // of each episode, in steps
  // Episodes that the daemon or the physics engine gave up (StepOutcome::given_up). They count in
  // the mean with their return until then.
  uint32_t given_up = 0;
  double mean_return = 0;
  double std_return = 0;        // population standard deviation over episodes
  std::optional<double> score;  // D4RL's normalised score of mean_return; needs reference returns
};

// What a policy gets in each step: one row for each episode that has not ended. All episodes begin
// together, with step 0.
struct PolicyBatch {
  uint32_t step = 0;
  std::span<const uint32_t> episodes;   // numbers of the rows' episodes, ascending
  std::span<const float> observations;  // rows x observation size, row-major
  std::span<float> actions;             // rows x action size, row-major: the policy fills it
};
// A policy without exploration. An error that it returns ends the evaluation.
using BatchPolicy = std::function<Status(const PolicyBatch& batch)>;

// Called with the session after the reset and after each step of lane 0 until that lane's episode
// has ended. An error that it returns ends the evaluation.
using EpisodeWatcher = std::function<Status(RemoteEnvironment& session)>;

// Plays one episode in each lane of `session`, which has the mode AutoresetMode::kDisabled and
// float32 observations. Errors: those of the session, the policy and the watcher.
Result<EvaluationResult> PlayEpisodes(RemoteEnvironment& session, uint64_t seed,
                                      const BatchPolicy& policy,
                                      const EpisodeWatcher& watch = nullptr);

}  // namespace b4mrl
