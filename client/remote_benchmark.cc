#include "client/remote_benchmark.h"

#include <fmt/format.h>

#include <utility>

#include "client/client.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

constexpr uint64_t kHeldOutSeed = 1;  // of `b4mrl evaluate`; evaluations in training have seed 0

// `policy` with what `mask` hides set to 0 in its observations.
BatchPolicy Masked(BatchPolicy policy, std::vector<uint8_t> mask) {
  return [policy = std::move(policy), mask = std::move(mask),
          seen = std::vector<float>()](const PolicyBatch& batch) mutable {
    seen.assign(batch.observations.begin(), batch.observations.end());
    for (size_t i = 0; i < seen.size(); ++i) {
      if (mask[i % mask.size()] == 0) seen[i] = 0;
    }
    return policy({batch.step, batch.episodes, seen, batch.actions});
  };
}

Status CheckNoLedger(uint64_t ledger) {
  if (ledger == 0) return Status();
  return InvalidArgument("ledger", fmt::format("{}", ledger), "0, as the benchmark has its own");
}

}  // namespace

RemoteBenchmark::RemoteBenchmark(Client* client, pb::BenchmarkInfo info,
                                 EnvironmentSpec environment, uint64_t ledger)
    : client_(client),
      info_(std::move(info)),
      environment_(std::move(environment)),
      learning_ledger_(ledger) {}

Result<uint64_t> RemoteBenchmark::Opened(uint64_t* ledger) {
  if (*ledger == 0) {
    B4MRL_ASSIGN_OR_RETURN(*ledger, client_->OpenLedger());
  }
  return *ledger;
}

Result<RemoteEnvironment> RemoteBenchmark::MakeSimulator(EnvironmentOptions options) {
  if (!options.simulator.empty()) {
    return InvalidArgument("simulator", FormatNamedArguments(options.simulator),
                           "none, as the benchmark has one of its own");
  }
  B4MRL_RETURN_IF_ERROR(CheckNoLedger(options.ledger));
  B4MRL_ASSIGN_OR_RETURN(options.simulator, ParseNamedArguments(info_.simulator()));
  B4MRL_ASSIGN_OR_RETURN(options.ledger, Opened(&learning_ledger_));
  return client_->Make(info_.environment(), std::move(options));
}

Result<RemoteDataset> RemoteBenchmark::OpenDataset(DatasetOptions options) {
  if (info_.dataset().empty()) {
    return Status(StatusCode::kFailedPrecondition, fmt::format("{} has no dataset", name()));
  }
  if (!options.corruption.empty()) {
    return InvalidArgument("corruption", FormatNamedArguments(options.corruption),
                           "none, as the benchmark has its own");
  }
  B4MRL_RETURN_IF_ERROR(CheckNoLedger(options.ledger));
  B4MRL_ASSIGN_OR_RETURN(options.ledger, Opened(&learning_ledger_));
  return OpenOwnDataset(std::move(options));
}

Result<RemoteDataset> RemoteBenchmark::OpenOwnDataset(DatasetOptions options) {
  B4MRL_ASSIGN_OR_RETURN(options.corruption, ParseNamedArguments(info_.corruption()));
  options.environment = info_.environment();
  return client_->OpenDataset(info_.dataset(), std::move(options));
}

Result<RemoteBenchmark::Training> RemoteBenchmark::ReadTraining() {
  Training training;
  training.mask.assign(environment_.observation.size(), 1);
  std::vector<NamedArgument> seen_through;
  if (info_.dataset().empty()) {
    B4MRL_ASSIGN_OR_RETURN(const RemoteEnvironment simulator, MakeSimulator());
    seen_through = NamedArgumentsOf(simulator.in_force().perturbations());
    for (const NamedArgument& item : seen_through) {
      if (item.name != "hidden") continue;
      const auto hidden = environment_.observation.ParseDimensions(item.argument);
      if (!hidden.ok()) return NotUnderstood(hidden.status());
      for (const uint32_t dimension : *hidden) training.mask[dimension] = 0;
    }
  } else {
    // Its rows are not served, so no ledger is taken for them.
    B4MRL_ASSIGN_OR_RETURN(const RemoteDataset dataset, OpenOwnDataset({}));
    seen_through = NamedArgumentsOf(dataset.in_force().corruptions());
    for (const uint32_t dimension : dataset.in_force().hidden_dimensions()) {
      if (dimension >= training.mask.size()) {
        return NotUnderstood(InvalidNumber("hidden dimension", dimension,
                                           fmt::format("0..{}", training.mask.size() - 1)));
      }
      training.mask[dimension] = 0;
    }
  }
  for (const NamedArgument& item : seen_through) {
    if (item.name == "obs-noise") training.noise.push_back(item);
  }
  return training;
}

Result<RemoteBenchmark::Training> RemoteBenchmark::KnownTraining() {
  if (!training_) {
    B4MRL_ASSIGN_OR_RETURN(training_, ReadTraining());
  }
  return *training_;
}

Result<std::vector<uint8_t>> RemoteBenchmark::Mask() {
  B4MRL_ASSIGN_OR_RETURN(Training training, KnownTraining());
  return std::move(training.mask);
}

Result<EvaluationResult> RemoteBenchmark::Evaluate(const BatchPolicy& policy,
                                                   const EvaluationOptions& options) {
  using Observe = EvaluationOptions::Observe;
  if (options.episodes == 0 || options.episodes > limits::kMaxLanesPerSession) {
    return InvalidNumber("episodes", options.episodes,
                         fmt::format("1..{}", limits::kMaxLanesPerSession));
  }
  EnvironmentOptions session_options;
  B4MRL_ASSIGN_OR_RETURN(session_options.simulator, ParseNamedArguments(info_.world()));
  BatchPolicy seeing = policy;
  if (options.observe != Observe::kFull) {
    B4MRL_ASSIGN_OR_RETURN(Training training, KnownTraining());
    seeing = Masked(policy, std::move(training.mask));
    if (options.observe == Observe::kServed) {
      if (training.noise.empty()) {
        return InvalidArgument("observe", "served",
                               fmt::format("trained, full: {} trains without noise", name()));
      }
      session_options.simulator.insert(session_options.simulator.end(), training.noise.begin(),
                                       training.noise.end());
    }
  }
  const uint64_t seed = options.held_out ? kHeldOutSeed : 0;
  session_options.num_envs = options.episodes;
  session_options.seed = seed;
  session_options.autoreset_mode = AutoresetMode::kDisabled;
  session_options.deadline_ms = options.deadline_ms;
  B4MRL_ASSIGN_OR_RETURN(session_options.ledger, Opened(&evaluation_ledger_));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session,
                         client_->Make(info_.environment(), std::move(session_options)));
  return PlayEpisodes(session, seed, seeing);
}

Result<BenchmarkUse> RemoteBenchmark::Use() {
  LedgerCounts learning, evaluations;
  if (learning_ledger_ != 0) {
    B4MRL_ASSIGN_OR_RETURN(learning, client_->ReadLedger(learning_ledger_));
  }
  if (evaluation_ledger_ != 0) {
    B4MRL_ASSIGN_OR_RETURN(evaluations, client_->ReadLedger(evaluation_ledger_));
  }
  return BenchmarkUse{learning.steps, learning.query_rows, learning.dataset_rows,
                      evaluations.episodes};
}

}  // namespace b4mrl
