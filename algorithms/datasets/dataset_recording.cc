#include "algorithms/datasets/dataset_recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "algorithms/base/learner.h"
#include "algorithms/base/progress.h"
#include "algorithms/episodes/behaviour.h"
#include "algorithms/episodes/collect.h"
#include "algorithms/episodes/replay.h"
#include "algorithms/policy/observation_mask.h"
#include "data/d4rl/dataset_file_reader.h"
#include "data/files/file_hash.h"
#include "proto/base/version.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

// The recording of one order: the file under way and what it is made of.
class Session {
 public:
  Session(const RecordingOrder& order, const EnvironmentSpec& environment, Client& client,
          bool quiet)
      : order_(order), environment_(environment), client_(client), progress_(quiet) {}

  Result<Recording> Run(const std::string& path);

 private:
  // Fills the provenance but for its parts.
  Status Describe(const std::string& simulator);
  Status RecordEpisodes();
  // Records by the order's agent of that number or, in an order without agents, random actions.
  Status RecordPart(size_t agent, uint64_t rows, uint64_t seed, bool whole);
  Status RecordReplay(const ActionLog& log);
  void AddPart(std::string policy, std::string sha256, uint64_t seed, uint64_t rows);
  Status WriteMetadata();

  const RecordingOrder& order_;
  const EnvironmentSpec& environment_;
  Client& client_;
  Progress progress_;
  std::optional<Recorder> recorder_;
  Recording recording_;
};

Result<Recording> Session::Run(const std::string& path) {
  const bool is_replay = order_.kind == RecipeKind::kReplay;
  B4MRL_RETURN_IF_ERROR(Describe(is_replay ? order_.log->simulator : order_.simulator));
  DatasetWriterOptions options;
  options.observation_dimensions = static_cast<uint32_t>(environment_.observation.size());
  options.action_dimensions = static_cast<uint32_t>(environment_.action.size());
  options.action_log_probs = !is_replay;  // a log holds no densities
  B4MRL_ASSIGN_OR_RETURN(recorder_, Recorder::Create(path, options));
  B4MRL_RETURN_IF_ERROR(is_replay ? RecordReplay(*order_.log) : RecordEpisodes());
  recording_.summary = recorder_->Summarise();
  if (recording_.summary.episodes > 0) {
    recording_.score = environment_.NormalisedScore(recording_.summary.mean_return);
  }
  B4MRL_RETURN_IF_ERROR(WriteMetadata());
  B4MRL_RETURN_IF_ERROR(recorder_->writer().Commit(order_.existing));
  return std::move(recording_);
}

Status Session::Describe(const std::string& simulator) {
  // A session says which dimensions are hidden, and resolves presets to numbers.
  EnvironmentOptions options;
  B4MRL_ASSIGN_OR_RETURN(options.simulator, ParseNamedArguments(simulator));
  options.seed = 0;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(const RemoteEnvironment session, client_.Make(environment_.name, options));
  const auto perturbations = NamedArgumentsOf(session.in_force().perturbations());
  DatasetProvenance& provenance = recording_.provenance;
  provenance.name = order_.name;
  provenance.environment = environment_.name;
  provenance.simulator = FormatNamedArguments(perturbations);
  B4MRL_ASSIGN_OR_RETURN(const std::vector<float> mask,
                         MaskOfPerturbations(session.spec().observation, perturbations));
  for (uint32_t i = 0; i < mask.size(); ++i) {
    if (mask[i] == 0) provenance.hidden_dimensions.push_back(i);
  }
  provenance.engine = client_.hello().engine_version();
  provenance.program = fmt::format("b4mrl {}", ProjectVersion());
  provenance.command = order_.command;
  provenance.license = kDataLicence;
  return Status();
}

// ---- whole episodes

Status Session::RecordEpisodes() {
  if (order_.kind == RecipeKind::kConcatenation) {
    recording_.provenance.recipe =
        "whole episodes of one agent in the first half of the rows, episodes of another from there";
    B4MRL_RETURN_IF_ERROR(RecordPart(/*agent=*/0, order_.rows / 2, order_.seed, /*whole=*/true));
    return RecordPart(/*agent=*/1, order_.rows - recorder_->rows(), order_.seed + 1,
                      /*whole=*/false);
  }
  recording_.provenance.recipe = "episodes of one behaviour policy";
  return RecordPart(/*agent=*/0, order_.rows, order_.seed, /*whole=*/false);
}

Status Session::RecordPart(size_t agent, uint64_t rows, uint64_t seed, bool whole) {
  CollectOptions options;
  options.environment = environment_.name;
  B4MRL_ASSIGN_OR_RETURN(options.simulator, ParseNamedArguments(order_.simulator));
  options.rows = rows;
  options.whole_episodes = whole;
  options.seed = seed;
  Behaviour behaviour = Behaviour::Uniform(environment_);
  std::string policy = "uniformly random actions", sha256;
  if (!order_.agents.empty()) {
    const Agent& acts = order_.agents[agent];
    B4MRL_ASSIGN_OR_RETURN(behaviour, Behaviour::OfAgent(acts, environment_));
    sha256 = order_.sha256[agent];
    policy = fmt::format("{} after {} updates", acts.provenance.algorithm, acts.provenance.updates);
    std::ranges::replace(policy, ';', ',');
  }
  DatasetProvenance& provenance = recording_.provenance;
  provenance.history_length =
      std::max(provenance.history_length, static_cast<uint32_t>(behaviour.history_length()));
  const uint64_t first_row = recorder_->rows();
  B4MRL_RETURN_IF_ERROR(Collect(options, behaviour, client_, *recorder_, progress_));
  AddPart(std::move(policy), std::move(sha256), seed, recorder_->rows() - first_row);
  return Status();
}

void Session::AddPart(std::string policy, std::string sha256, uint64_t seed, uint64_t rows) {
  if (rows == 0) return;  // no episode fits into the first half of a concatenation
  recording_.provenance.parts.push_back({std::move(policy), std::move(sha256), seed, rows});
}

// ---- replays

Status Session::RecordReplay(const ActionLog& log) {
  if (log.environment != environment_.name) {
    return InvalidArgument("environment of the action log", log.environment, environment_.name);
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t first_episode,
                         ReplayActions(log, order_.rows, client_, *recorder_, progress_));
  recording_.provenance.recipe = fmt::format(
      "the transitions of a training run, stepped again from its actions: {}", log.command);
  AddPart("a learner in training, its warm-up included", order_.sha256.front(), log.seed,
          recorder_->rows());
  return recorder_->writer().SetMetadata(kReplayFirstEpisode, static_cast<int64_t>(first_episode));
}

Status Session::WriteMetadata() {
  DatasetWriter& writer = recorder_->writer();
  const RecordingSummary& summary = recording_.summary;
  B4MRL_RETURN_IF_ERROR(writer.SetProvenance(recording_.provenance));
  if (order_.kind == RecipeKind::kAgent) {
    Agent agent = order_.agents.front();
    agent.provenance.environment = environment_.name;  // it may be another task's, of equal sizes
    B4MRL_RETURN_IF_ERROR(writer.SetPolicy(agent));
  } else {
    std::string policies;
    for (const RecordedPart& part : recording_.provenance.parts) {
      policies += (policies.empty() ? "" : ", then ") + part.policy;
    }
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("behaviour_policy", policies));
  }
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("columns_sha256", summary.columns_sha256));
  if (summary.episodes == 0) return Status();
  B4MRL_RETURN_IF_ERROR(
      writer.SetMetadata("mean_return", fmt::format("{:.9g}", summary.mean_return)));
  B4MRL_RETURN_IF_ERROR(
      writer.SetMetadata("std_return", fmt::format("{:.9g}", summary.std_return)));
  if (!recording_.score) return Status();
  return writer.SetMetadata("normalised_score", fmt::format("{:.9g}", *recording_.score));
}

}  // namespace

Status ReadFiles(RecordingOrder& order) {
  for (const std::string& file : order.files) {
    if (order.kind == RecipeKind::kReplay) {
      B4MRL_ASSIGN_OR_RETURN(order.log, ReadActionLog(file));
    } else {
      B4MRL_ASSIGN_OR_RETURN(Agent agent, ReadAgent(file));
      order.agents.push_back(std::move(agent));
    }
    B4MRL_ASSIGN_OR_RETURN(std::string sha256, Sha256OfFile(file));
    order.sha256.push_back(std::move(sha256));
  }
  return Status();
}

Status CheckAgents(const RecordingOrder& order, const EnvironmentSpec& environment) {
  for (const Agent& agent : order.agents) {
    B4MRL_RETURN_IF_ERROR(Behaviour::OfAgent(agent, environment).status());
  }
  return Status();
}

Result<Recording> Record(const RecordingOrder& order, const EnvironmentSpec& environment,
                         const std::string& path, Client& client, bool quiet) {
  return Session(order, environment, client, quiet).Run(path);
}

}  // namespace b4mrl
