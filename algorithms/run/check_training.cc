#include "algorithms/run/check_training.h"

#include <fmt/format.h>

#include <algorithm>

#include "algorithms/list.h"
#include "data/d4rl/agent_file.h"

namespace b4mrl {
namespace {

// Refuses a precision that no product of the run would have. An ensemble has four hidden layers.
Status CheckPrecisionHasProducts(const TrainOptions& options, const Algorithm& algorithm) {
  const Hyperparameters& values = options.hyperparameters;
  if (options.precision == Precision::kFp32 || values.NumberOr("hidden-layers", 2) > 1 ||
      values.Find("ensemble-members") != nullptr) {
    return Status();
  }
  return InvalidArgument(
      "--precision", PrecisionName(options.precision),
      fmt::format("{} with the one hidden layer of {}: a lower precision is for products between "
                  "two hidden layers",
                  PrecisionName(Precision::kFp32), algorithm.name));
}

}  // namespace

Result<Hyperparameters> ReadHyperparameters(
    const Algorithm& algorithm, const std::string& environment,
    std::span<const std::pair<std::string, std::string>> texts) {
  Hyperparameters values(algorithm.hyperparameters, environment);
  for (const auto& [name, text] : texts) B4MRL_RETURN_IF_ERROR(values.SetText(name, text));
  return values;
}

Status CheckNeeds(const TrainOptions& options, const Algorithm& algorithm) {
  const auto refuse = [&](std::string_view option, std::string_view value, std::string_view rule) {
    return InvalidArgument(option, value, fmt::format("{} with {}", rule, algorithm.name));
  };
  if (options.environment.empty()) return InvalidArgument("--environment", "", "a name");
  if (algorithm.needs.dataset && options.dataset.empty()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("--dataset is missing: {} learns from a dataset", algorithm.name));
  }
  if (!algorithm.needs.dataset && !options.dataset.empty()) {
    return InvalidArgument(
        "--dataset", options.dataset,
        fmt::format("nothing, as {} learns in the simulator alone", algorithm.name));
  }
  if (!algorithm.needs.dataset && !options.corruption.empty()) {
    return refuse("--corruption", options.corruption, "nothing");
  }
  if (!algorithm.needs.dataset && options.corruption_seed != 0) {
    return refuse("--corruption-seed", fmt::format("{}", options.corruption_seed), "nothing");
  }
  // A run that an earlier version began can be resumed: the seed changes nothing of it.
  if (options.corruption.empty() && options.corruption_seed != 0 && !options.resume) {
    return InvalidArgument("--corruption-seed", fmt::format("{}", options.corruption_seed),
                           "0 without --corruption, whose noise it seeds");
  }
  if (!algorithm.needs.dataset && options.transitions != "stored") {
    return refuse("--transitions", options.transitions, "nothing");
  }
  if (!algorithm.needs.simulator && !options.simulator.empty()) {
    return refuse("--simulator", options.simulator, "nothing");
  }
  if (!algorithm.needs.history && options.history_length != 1) {
    return refuse("--history", fmt::format("{}", options.history_length), "1");
  }
  return Status();
}

Status CheckTraining(const TrainOptions& options, const EnvironmentSpec& environment) {
  LearnerContext context;
  context.environment = environment;
  context.history_length = options.history_length;
  context.seed = options.seed;
  context.precision = options.precision;
  context.hyperparameters = options.hyperparameters;
  B4MRL_ASSIGN_OR_RETURN(const Algorithm* algorithm, FindAlgorithm(options.algorithm));
  B4MRL_RETURN_IF_ERROR(CheckPrecisionHasProducts(options, *algorithm));
  B4MRL_RETURN_IF_ERROR(CheckPrecision(options.precision));
  B4MRL_RETURN_IF_ERROR(environment.CheckActionScale());
  const uint64_t values = environment.observation.size();
  const uint64_t most = std::min<uint64_t>(kMaxAgentHistory, kMaxAgentLayerWidth / values);
  if (options.history_length < 1 || options.history_length > most) {
    return InvalidNumber("--history", options.history_length,
                         fmt::format("1..{} with the {} values of an observation of {}", most,
                                     values, environment.name));
  }
  if (options.stop_at_score && !environment.NormalisedScore(0)) {
    return InvalidNumber(
        "--stop-at-score", *options.stop_at_score,
        fmt::format("nothing in {}, which has no scores but returns alone", environment.name));
  }
  return algorithm->check == nullptr ? Status() : algorithm->check(context);
}

}  // namespace b4mrl
