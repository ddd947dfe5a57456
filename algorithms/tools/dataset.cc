// b4mrl dataset: the group of commands, and of them `info`, which describes a dataset as a daemon
// serves it.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_pictures.h"
#include "algorithms/tools/dataset_source.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

struct InfoCommand {
  DatasetSource source;
  std::string pictures;  // the folder for pictures; "" for none
  bool json = false;

  std::optional<Failure> Run() const;
  std::optional<Failure> Describe(Client& client, RemoteDataset& dataset) const;
};

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

// "hidden=9", "obs-noise=0.1 with the seed 3"; "" if there is none.
std::string CorruptionOf(const pb::OpenDatasetReply& in_force) {
  const std::string text = FormatNamedArguments(NamedArgumentsOf(in_force.corruptions()));
  if (in_force.seed() == 0) return text;
  return fmt::format("{} with the seed {}", text, in_force.seed());
}

// Prints the description, after the pictures have been written if they are wanted.
std::optional<Failure> InfoCommand::Describe(Client& client, RemoteDataset& dataset) const {
  const auto stats = dataset.Stats();
  if (!stats.ok()) return FromDaemon(stats.status());
  const auto odd_rows = CountOddRows(dataset, SpaceSpec());
  if (!odd_rows.ok()) return FromDaemon(odd_rows.status());
  const pb::DatasetStatsReply& scores = stats->scores;
  const pb::DatasetInfo& info = dataset.in_force().info();
  nlohmann::ordered_json out = {{"name", info.name()},
                                {"environment", dataset.environment()},
                                {"rows", dataset.rows()},
                                {"nonfinite_rows", odd_rows->nonfinite},
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
                                {"corruption", CorruptionOf(dataset.in_force())},
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
  if (!pictures.empty()) {
    const auto paths = WriteDatasetPictures(client, dataset, pictures, source.quiet);
    if (!paths.ok()) return FromDaemon(paths.status());
    out["pictures"] = *paths;
  }
  constexpr auto kReplace = nlohmann::json::error_handler_t::replace;  // of what is not UTF-8
  if (json) {
    out["observation_mean"] = stats->observation_mean;
    out["observation_std"] = stats->observation_std;
    fmt::print("{}\n", out.dump(2, ' ', false, kReplace));
    return std::nullopt;
  }
  for (const auto& [key, value] : out.items()) {
    fmt::print("{:<18} {}\n", key,
               value.is_string() ? value.get<std::string>() : value.dump(-1, ' ', false, kReplace));
  }
  return std::nullopt;
}

std::optional<Failure> InfoCommand::Run() const {
  return source.Open(
      [this](Client& client, RemoteDataset& dataset) { return Describe(client, dataset); });
}

Command AddDatasetInfo(CLI::App& group) {
  const auto command = std::make_shared<InfoCommand>();
  CLI::App* app = group.add_subcommand(
      "info", "a dataset's size, returns and hash; with --json also its moments");
  command->source.AddTo(*app);
  app->add_option("--svg", command->pictures,
                  "folder for pictures: returns.svg, observations.svg (clean against corrupted, "
                  "with --corruption), actions.svg");
  app->add_flag("--json", command->json, "print the description as JSON");
  return {app, [command] { return command->Run(); }};
}

}  // namespace

std::vector<Command> AddDatasetCommands(CLI::App& app) {
  CLI::App* group =
      app.add_subcommand("dataset", "make, import, verify, export or describe datasets");
  group->require_subcommand(1);
  std::vector<Command> commands = AddDatasetMake(*group);
  for (auto* add_commands : {AddDatasetImport, AddDatasetVerify, AddDatasetExport}) {
    for (Command& command : add_commands(*group)) commands.push_back(std::move(command));
  }
  commands.push_back(AddDatasetInfo(*group));
  return commands;
}

}  // namespace b4mrl
