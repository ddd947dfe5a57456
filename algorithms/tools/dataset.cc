// b4mrl dataset make|import|export|info. Files are written here; whatever is to be looked into is
// read through the daemon, whose importer distrusts it in a sandbox.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>

#include "algorithms/episodes/collect.h"
#include "algorithms/policy/agent_policy.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "client/interrupt.h"
#include "data/d4rl/agent_file.h"
#include "data/d4rl/dataset_file_writer.h"
#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"
#include "proto/base/folders.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// A daemon's data folder, and the file in it that a command is about to write. The order of the
// members is that of their ends in reverse: the daemon goes before its folders do.
struct Destination {
  NewFolders folders;
  std::optional<DaemonConnection> connection;
  std::string path;
};

struct DatasetCommand {
  std::string name, agent_path, file, corruption;
  uint64_t rows = 1'000'000;
  uint64_t seed = 0;
  bool quiet = false;
  bool json = false;
  bool replace = false;
  DaemonOptions daemon;

  std::optional<Failure> Make();
  std::optional<Failure> Import();
  std::optional<Failure> Export(Client&, RemoteDataset& dataset);
  std::optional<Failure> Info(Client& client, RemoteDataset& dataset);
  // Opens the named, possibly corrupted dataset for one of these two.
  std::optional<Failure> WithDataset(std::optional<Failure> (DatasetCommand::*use)(Client&,
                                                                                   RemoteDataset&));

  // Opens the daemon and makes room for the new dataset where the daemon will look for it. `advice`
  // is for a name that is taken.
  std::optional<Failure> Prepare(Destination& destination, std::string_view advice) const;
  Result<std::string> AgentPath() const;
  Result<CollectSummary> WriteEpisodes(const Agent& agent, const std::string& agent_file,
                                       const std::string& path, Client& client);
  Status CopyInto(const std::string& path) const;
  Status WriteExport(RemoteDataset& dataset);
};

std::optional<Failure> DatasetCommand::Prepare(Destination& destination,
                                               std::string_view advice) const {
  const auto parts = ParseDatasetName(name);
  if (!parts.ok()) return BadInput(parts.status());
  if (!daemon.data_folder.empty()) {
    if (Status status = destination.folders.Make(daemon.data_folder); !status.ok()) {
      return BadInput(std::move(status));
    }
  }
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  destination.connection.emplace(*std::move(connection));
  const auto data_folder = destination.connection->DataFolder();
  if (!data_folder.ok()) return FromDaemon(data_folder.status());
  destination.path = DatasetPath(*data_folder, *parts);
  if (std::error_code error; !replace && fs::exists(destination.path, error)) {
    return BadInput(Status(StatusCode::kFailedPrecondition,
                           fmt::format("{} exists; {}", destination.path, advice)));
  }
  if (Status status = destination.folders.Make(FolderOf(destination.path)); !status.ok()) {
    return BadInput(std::move(status));
  }
  return std::nullopt;
}

// ---- make

// The given one, or the shipped behaviour policy, such as halfcheetah-medium.h5.
Result<std::string> DatasetCommand::AgentPath() const {
  if (!agent_path.empty()) return agent_path;
  const char* variable = std::getenv("B4MRL_AGENTS");
  const std::string folder = variable != nullptr && *variable != '\0'
                                 ? variable
                                 : SharedFolder("agents", B4MRL_AGENTS_FOLDER);
  std::string stem = name;
  std::replace(stem.begin(), stem.end(), '/', '-');
  std::transform(stem.begin(), stem.end(), stem.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const std::string path = fmt::format("{}/{}.h5", folder, stem);
  if (std::error_code error; fs::exists(path, error)) return path;
  return Status(
      StatusCode::kUnknownName,
      fmt::format("no behaviour policy is shipped for {} ({}); name one with --agent", name, path));
}

std::optional<Failure> DatasetCommand::Make() {
  const auto agent_file = AgentPath();
  if (!agent_file.ok()) return BadInput(agent_file.status());
  const auto agent = ReadAgent(*agent_file);
  if (!agent.ok()) return BadInput(agent.status());
  Destination destination;
  if (auto failure = Prepare(destination, "choose another name, or --replace it")) return failure;
  const std::string& path = destination.path;
  const auto summary = WriteEpisodes(*agent, *agent_file, path, destination.connection->client());
  if (!summary.ok()) return FromDaemon(summary.status());
  const auto sha256 = Sha256OfFile(path);
  if (!sha256.ok()) return BadInput(sha256.status());
  if (json) {
    const nlohmann::ordered_json out = {{"name", name},
                                        {"file", path},
                                        {"rows", summary->rows},
                                        {"episodes", summary->episodes},
                                        {"mean_return", summary->mean_return},
                                        {"sha256", *sha256}};
    fmt::print("{}\n", out.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  } else {
    fmt::print("{}: {} rows, {} episodes, mean return {:.1f}\nsha256 {}\n", path, summary->rows,
               summary->episodes, summary->mean_return, *sha256);
  }
  return std::nullopt;
}

Result<CollectSummary> DatasetCommand::WriteEpisodes(const Agent& agent,
                                                     const std::string& agent_file,
                                                     const std::string& path, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const AgentPolicy policy, AgentPolicy::Create(agent));
  B4MRL_ASSIGN_OR_RETURN(const DatasetName parts, ParseDatasetName(name));
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec environment, client.FindEnvironment(parts.folder));
  DatasetWriterOptions options;
  options.observation_dimensions = agent.observation_dimensions;
  options.action_dimensions = agent.action_dimensions;
  options.action_log_probs = true;
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  Progress progress(quiet);
  CollectOptions collect;
  collect.environment = parts.folder;
  collect.rows = rows;
  collect.seed = seed;
  B4MRL_ASSIGN_OR_RETURN(const CollectSummary summary,
                         Collect(collect, policy, client, writer, progress));
  B4MRL_ASSIGN_OR_RETURN(const std::string agent_sha256, Sha256OfFile(agent_file));
  Agent behaviour = agent;  // may have been trained on another task of the same sizes
  behaviour.provenance.environment = environment.name;
  B4MRL_RETURN_IF_ERROR(writer.SetPolicy(behaviour));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("dataset_name", name));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("dataset_seed", static_cast<int64_t>(seed)));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("agent_sha256", agent_sha256));
  B4MRL_RETURN_IF_ERROR(
      writer.SetMetadata("mean_return", fmt::format("{:.9g}", summary.mean_return)));
  if (const auto score = environment.NormalisedScore(summary.mean_return)) {
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("normalised_score", fmt::format("{:.9g}", *score)));
  }
  B4MRL_RETURN_IF_ERROR(writer.Commit());
  return summary;
}

// ---- import

// The daemon names the copy that it read, which is gone.
Status InTermsOf(const std::string& original, const std::string& copy, const Status& status) {
  std::string message = status.message();
  for (size_t at = 0; (at = message.find(copy, at)) != std::string::npos; at += original.size()) {
    message.replace(at, copy.size(), original);
  }
  return Status(status.code(), std::move(message));
}

std::optional<Failure> DatasetCommand::Import() {
  Destination destination;
  if (auto failure = Prepare(destination, "choose another --name or remove it")) return failure;
  if (Status status = CopyInto(destination.path); !status.ok()) return BadInput(std::move(status));
  const auto dataset = destination.connection->client().OpenDataset(name);
  if (!dataset.ok()) {
    std::error_code ignored;  // a file that is no dataset must not stay under a dataset's name
    fs::remove(destination.path, ignored);
    return BadInput(InTermsOf(file, destination.path, dataset.status()));
  }
  fmt::print("{}: {} rows, sha256 {}\n", name, dataset->rows(),
             dataset->in_force().info().sha256());
  return std::nullopt;
}

Status DatasetCommand::CopyInto(const std::string& path) const {
  std::ifstream in(file, std::ios::binary);
  if (!in) return IoError("read", file, errno);
  B4MRL_ASSIGN_OR_RETURN(AtomicFile out, AtomicFile::Create(path));
  std::vector<char> block(1 << 20);
  while (in) {
    if (Interrupted()) return Status(StatusCode::kUnavailable, "interrupted");
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto count = static_cast<size_t>(in.gcount());
    B4MRL_RETURN_IF_ERROR(out.Write(std::string_view(block.data(), count)));
  }
  if (in.bad()) return IoError("read", file, errno);
  return out.Commit();
}

// ---- export and info

std::optional<Failure> DatasetCommand::WithDataset(
    std::optional<Failure> (DatasetCommand::*use)(Client&, RemoteDataset&)) {
  const auto corruptions = ParseNamedArguments(corruption);
  if (!corruptions.ok()) return BadUsage(corruptions.status());
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  DatasetOptions options;
  options.corruption = *corruptions;
  options.seed = seed;
  auto dataset = connection->client().OpenDataset(name, options);
  if (!dataset.ok()) return FromDaemon(dataset.status());
  return (this->*use)(connection->client(), *dataset);
}

std::optional<Failure> DatasetCommand::Export(Client&, RemoteDataset& dataset) {
  if (Status status = WriteExport(dataset); !status.ok()) return FromDaemon(std::move(status));
  fmt::print("{}: {} rows of {}\n", file, dataset.rows(), name);
  return std::nullopt;
}

Status DatasetCommand::WriteExport(RemoteDataset& dataset) {
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
  const pb::OpenDatasetReply& source = dataset.in_force();
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("environment", dataset.environment()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source", name));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source_sha256", source.info().sha256()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("corruption", corruption));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("corruption_seed", static_cast<int64_t>(seed)));
  return writer.Commit();
}

std::optional<Failure> DatasetCommand::Info(Client& client, RemoteDataset& dataset) {
  const auto stats = dataset.Stats();
  if (!stats.ok()) return FromDaemon(stats.status());
  const pb::DatasetStatsReply& scores = stats->scores;
  const pb::DatasetInfo& info = dataset.in_force().info();
  nlohmann::ordered_json out = {{"name", name},
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
                                {"behaviour_policy", info.behaviour_policy()},
                                {"fingerprint", dataset.fingerprint()}};
  const auto environment = client.FindEnvironment(dataset.environment());
  if (environment.ok()) {  // others have no reference scores
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
  CLI::App* group = app.add_subcommand("dataset", "make, import, export or describe datasets");
  group->require_subcommand(1);
  const auto add = [&](const char* word, const char* description) {
    auto command = std::make_shared<DatasetCommand>();
    CLI::App* sub = group->add_subcommand(word, description);
    sub->add_flag("--quiet", command->quiet, "no progress on stderr");
    command->daemon.AddTo(*sub);
    return std::pair{command, sub};
  };

  const auto [make, make_app] = add("make", "roll out a behaviour policy");
  make_app->add_option("name", make->name, "\"HalfCheetah/medium\"")->required();
  make_app->add_option("--rows", make->rows, "transitions [1000000]")
      ->transform(Count(1, limits::kMaxDatasetRows));
  make_app->add_option("--seed", make->seed, "of environments and policy [0]")->transform(Seed());
  make_app->add_option("--agent", make->agent_path, "behaviour policy; none: the shipped one");
  make_app->add_flag("--replace", make->replace, "where a file of that name exists");
  make_app->add_flag("--json", make->json, "print JSON");

  const auto [import, import_app] = add("import", "check a D4RL-layout HDF5 file and copy it in");
  import_app->add_option("file", import->file, "HDF5 file")->required();
  import_app->add_option("--name", import->name, "its name here: \"HalfCheetah/mine\"")->required();

  const auto [exported, export_app] = add("export", "write a dataset, corrupted if asked, as HDF5");
  export_app->add_option("name", exported->name, "dataset")->required();
  export_app->add_option("file", exported->file, "HDF5 file to write")->required();
  export_app->add_option("--corruption", exported->corruption, "\"hidden=9,obs-noise=0.02\"");
  export_app->add_option("--seed", exported->seed, "of the corruption's noise [0]")
      ->transform(Seed());

  const auto [info, info_app] = add("info", "size, returns, moments and hash");
  info_app->add_option("name", info->name, "dataset")->required();
  info_app->add_option("--corruption", info->corruption, "as of export");
  info_app->add_option("--seed", info->seed, "of the corruption's noise [0]")->transform(Seed());
  info_app->add_flag("--json", info->json, "print JSON");

  return {
      {make_app, [command = make] { return command->Make(); }},
      {import_app, [command = import] { return command->Import(); }},
      {export_app, [command = exported] { return command->WithDataset(&DatasetCommand::Export); }},
      {info_app, [command = info] { return command->WithDataset(&DatasetCommand::Info); }}};
}

}  // namespace b4mrl
