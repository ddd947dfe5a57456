// b4mrl dataset export|info: the commands that read a dataset through the daemon, whose sandboxed
// importer reads the untrusted file.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "algorithms/base/progress.h"
#include "algorithms/tools/command.h"
#include "data/d4rl/dataset_file_writer.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

struct ReadCommand {
  std::string name, file, corruption, transitions = "stored";
  uint64_t corruption_seed = 0;
  bool quiet = false;
  bool json = false;
  DaemonOptions daemon;

  // Opens the dataset with its corruptions and calls `use`, which is Export or Info.
  using Use = std::optional<Failure> (ReadCommand::*)(Client&, RemoteDataset&);
  std::optional<Failure> WithDataset(Use use);
  std::optional<Failure> Export(Client&, RemoteDataset& dataset);
  std::optional<Failure> Info(Client& client, RemoteDataset& dataset);

  Status WriteExport(RemoteDataset& dataset);
};

// What an exported file says of its rows: what its source says, with the environment and the hidden
// dimensions of the dataset as it is served. Its rows may differ from the source's, so it has
// neither the source's name nor its parts.
DatasetProvenance ProvenanceOf(const RemoteDataset& dataset) {
  const pb::OpenDatasetReply& source = dataset.in_force();
  const pb::DatasetProvenance& said = source.provenance();
  DatasetProvenance provenance;
  provenance.environment = dataset.environment();
  provenance.simulator = said.simulator();
  provenance.hidden_dimensions.assign(source.hidden_dimensions().begin(),
                                      source.hidden_dimensions().end());
  provenance.history_length = std::max(said.history_length(), 1u);
  provenance.recipe = said.recipe();
  provenance.engine = said.engine();
  provenance.program = said.program();
  provenance.license = said.license();
  return provenance;
}

// Where the rows come from, as far as the file says.
void AddProvenance(const pb::OpenDatasetReply& source, nlohmann::ordered_json* out) {
  const pb::DatasetProvenance& said = source.provenance();
  nlohmann::ordered_json& json = *out;
  if (said.environment().empty()) {
    json["environment_from"] = source.environment().empty() ? "" : "the dataset's name";
  } else {
    json["environment_from"] = "the file";
  }
  json["hidden_dimensions"] = source.hidden_dimensions();
  for (const auto& [key, text] :
       {std::pair{"full_name", &said.name()}, std::pair{"recorded_in", &said.simulator()},
        std::pair{"recipe", &said.recipe()}, std::pair{"engine", &said.engine()},
        std::pair{"program", &said.program()}, std::pair{"command", &said.command()},
        std::pair{"license", &said.license()}}) {
    if (!text->empty()) json[key] = *text;
  }
  if (said.history_length() > 1) json["history_length"] = said.history_length();
  for (const pb::RecordedPart& part : said.parts()) {
    json["parts"].push_back({{"policy", part.policy()},
                             {"policy_sha256", part.policy_sha256()},
                             {"seed", part.seed()},
                             {"rows", part.rows()}});
  }
}

std::optional<Failure> ReadCommand::WithDataset(Use use) {
  const auto corruptions = ParseNamedArguments(corruption);
  if (!corruptions.ok()) return BadUsage(corruptions.status());
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  DatasetOptions options;
  options.corruption = *corruptions;
  options.seed = corruption_seed;
  options.transition_rule = transitions;
  auto dataset = connection->client().OpenDataset(name, options);
  if (!dataset.ok()) return FromDaemon(dataset.status());
  return (this->*use)(connection->client(), *dataset);
}

std::optional<Failure> ReadCommand::Export(Client&, RemoteDataset& dataset) {
  if (Status status = WriteExport(dataset); !status.ok()) return FromDaemon(std::move(status));
  fmt::print("{}: {} rows of {}\n", file, dataset.rows(), dataset.in_force().info().name());
  return std::nullopt;
}

Status ReadCommand::WriteExport(RemoteDataset& dataset) {
  constexpr uint32_t kRowsPerRead = 16'384;
  DatasetWriterOptions options;
  options.observation_dimensions = static_cast<uint32_t>(dataset.observation_size());
  options.action_dimensions = static_cast<uint32_t>(dataset.action_size());
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(file, options));
  const uint32_t most = std::min(kRowsPerRead, dataset.max_rows_per_request());
  Progress progress(quiet);
  progress.Start("export", "rows", dataset.rows());
  while (writer.rows() < dataset.rows()) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows served, dataset.Read(writer.rows(), most));
    if (served.rows == 0) return Status(StatusCode::kDataLoss, "the dataset ended too early");
    DatasetRows out;
    out.rows = served.rows;
    out.observations = served.observations;
    out.actions = served.actions;
    out.next_observations = served.next_observations;
    out.rewards = served.rewards;
    out.terminals = served.terminals;
    out.timeouts = served.timeouts;
    B4MRL_RETURN_IF_ERROR(writer.Append(out));
    progress.Update(writer.rows());
  }
  B4MRL_RETURN_IF_ERROR(writer.SetProvenance(ProvenanceOf(dataset)));
  const pb::OpenDatasetReply& source = dataset.in_force();
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source", source.info().name()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source_sha256", source.info().sha256()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("corruption", corruption));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("corruption_seed", static_cast<int64_t>(source.seed())));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("transitions", source.transition_rule()));
  return writer.Commit();
}

std::optional<Failure> ReadCommand::Info(Client& client, RemoteDataset& dataset) {
  const auto stats = dataset.Stats();
  if (!stats.ok()) return FromDaemon(stats.status());
  const pb::DatasetStatsReply& scores = stats->scores;
  const pb::DatasetInfo& info = dataset.in_force().info();
  nlohmann::ordered_json out = {{"name", info.name()},
                                {"environment", dataset.environment()},
                                {"rows", dataset.rows()},
                                {"episodes", scores.episodes()},
                                {"observation_size", dataset.observation_size()},
                                {"action_size", dataset.action_size()},
                                {"mean_return", scores.mean_return()},
                                {"std_return", scores.std_return()},
                                {"min_return", scores.min_return()},
                                {"max_return", scores.max_return()},
                                {"min_reward", scores.min_reward()},
                                {"max_reward", scores.max_reward()},
                                {"file_bytes", info.file_bytes()},
                                {"sha256", info.sha256()},
                                {"columns_sha256", info.columns_sha256()},
                                {"transitions", dataset.in_force().transition_rule()},
                                {"behaviour_policy", info.behaviour_policy()},
                                {"fingerprint", dataset.fingerprint()}};
  AddProvenance(dataset.in_force(), &out);
  const auto environment = client.FindEnvironment(dataset.environment());
  if (environment.ok()) {  // unknown environments have no reference returns
    if (const auto score = environment->NormalisedScore(scores.mean_return())) {
      out["behaviour_score"] = *score;
    }
  }
  if (json) {
    out["observation_mean"] = stats->observation_mean;
    out["observation_std"] = stats->observation_std;
    fmt::print("{}\n", out.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
    return std::nullopt;
  }
  for (const auto& [key, value] : out.items()) {
    fmt::print("{:<18} {}\n", key, value.is_string() ? value.get<std::string>() : value.dump());
  }
  return std::nullopt;
}

}  // namespace

std::vector<Command> AddDatasetCommands(CLI::App& app) {
  CLI::App* group =
      app.add_subcommand("dataset", "make, import, verify, export or describe datasets");
  group->require_subcommand(1);
  std::vector<Command> commands = AddDatasetMake(*group);
  for (auto* add_commands : {AddDatasetImport, AddDatasetVerify}) {
    for (Command& command : add_commands(*group)) commands.push_back(std::move(command));
  }
  const auto add = [&](const char* word, const char* description, ReadCommand::Use use) {
    auto command = std::make_shared<ReadCommand>();
    CLI::App* sub = group->add_subcommand(word, description);
    sub->add_option("name", command->name, "name of the dataset: \"HalfCheetah/medium\"")
        ->required();
    sub->add_option("--corruption", command->corruption,
                    "corruptions of the dataset: \"hidden=9,obs-noise=0.02\"");
    AddCorruptionSeed(*sub, command->corruption_seed);
    AddTransitions(*sub, command->transitions);
    sub->add_flag("--quiet", command->quiet, "show no progress on stderr");
    command->daemon.AddTo(*sub);
    commands.push_back({sub, [command, use] { return command->WithDataset(use); }});
    return std::pair{command, sub};
  };

  const auto [exported, export_app] =
      add("export", "write a dataset, corrupted if asked, as HDF5", &ReadCommand::Export);
  export_app->add_option("file", exported->file, "HDF5 file to write")->required();

  const auto [info, info_app] =
      add("info", "a dataset's size, returns, moments and hash", &ReadCommand::Info);
  info_app->add_flag("--json", info->json, "print the description as JSON");
  return commands;
}

}  // namespace b4mrl
