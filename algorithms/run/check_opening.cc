#include "algorithms/run/check_opening.h"

#include <string>

#include "algorithms/base/learner.h"

namespace b4mrl {

Status CheckOpening(const TrainOptions& options, Client& client) {
  for (const std::string& text : {options.simulator, options.world}) {
    if (text.empty()) continue;  // every environment opens without perturbations
    EnvironmentOptions session;
    session.deadline_ms = kLearnerDeadlineMs;
    B4MRL_ASSIGN_OR_RETURN(session.simulator, ParseNamedArguments(text));
    B4MRL_RETURN_IF_ERROR(client.Make(options.environment, session).status());
  }
  if (options.dataset.empty()) return Status();
  DatasetOptions dataset;
  B4MRL_ASSIGN_OR_RETURN(dataset.corruption, ParseNamedArguments(options.corruption));
  // As the learner will: else the daemon would prepare other rows than the run's.
  dataset.seed = options.corruption_seed;
  dataset.transition_rule = options.transitions;
  dataset.environment = options.environment;
  B4MRL_ASSIGN_OR_RETURN(const RemoteDataset opened, client.OpenDataset(options.dataset, dataset));
  // A run that an earlier version began can be resumed: the seed changes nothing of it.
  return options.resume ? Status() : CheckCorruptionSeed(options.corruption_seed, opened);
}

Status CheckCorruptionSeed(uint64_t seed, const RemoteDataset& opened) {
  if (seed == 0 || opened.in_force().seed() != 0) return Status();
  return InvalidNumber("--corruption-seed", seed,
                       "0 where no --corruption draws numbers (`hidden` draws none)");
}

}  // namespace b4mrl
