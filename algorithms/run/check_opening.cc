#include "algorithms/run/check_opening.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/list.h"

namespace b4mrl {
namespace {

// Whether the run's simulator answers queries: by a query of one row, of which any answer will do.
Status CheckQueries(const TrainOptions& options, Client& client) {
  EnvironmentOptions session;
  session.num_envs = 0;  // for queries alone
  session.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(session.simulator, ParseNamedArguments(options.simulator));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment simulator, client.Make(options.environment, session));
  const std::vector<float> observation(simulator.spec().observation.size());
  const std::vector<float> action(simulator.spec().action.size());
  std::vector<float> next(observation.size());
  std::array<double, 1> reward{};
  std::array<uint8_t, 1> terminated{}, valid{};
  const QueryOutput output = {next, reward, terminated, valid};
  return simulator.Query(observation, action, output);
}

}  // namespace

Status CheckOpening(const TrainOptions& options, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const Algorithm* algorithm, FindAlgorithm(options.algorithm));
  for (const std::string& text : {options.simulator, options.world}) {
    if (text.empty()) continue;  // every environment opens without perturbations
    EnvironmentOptions session;
    session.deadline_ms = kLearnerDeadlineMs;
    B4MRL_ASSIGN_OR_RETURN(session.simulator, ParseNamedArguments(text));
    B4MRL_RETURN_IF_ERROR(client.Make(options.environment, session).status());
  }
  if (algorithm->needs.queries) B4MRL_RETURN_IF_ERROR(CheckQueries(options, client));
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
