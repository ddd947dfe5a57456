// b4mrl dataset make|import: the commands that write a file into a daemon's data folder.
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
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// A daemon's data folder, and the file in it that a command is about to write. Members are
// destroyed in reverse order: first the daemon's connection, then the folders.
struct Destination {
  NewFolders folders;
  std::optional<DaemonConnection> connection;
  std::string path;
};

struct WriteCommand {
  std::string name, agent_path, file;
  uint64_t rows = 1'000'000;
  uint64_t seed = 0;
  bool quiet = false;
  bool json = false;
  bool replace = false;
  DaemonOptions daemon;

  std::optional<Failure> Make();
  std::optional<Failure> Import();

  // Opens the daemon and makes the folder in which it will look for the new dataset. `advice` is
  // part of the error message for a name that is taken.
  std::optional<Failure> Prepare(Destination& destination, std::string_view advice) const;
  Result<std::string> AgentPath() const;
  Result<CollectSummary> WriteEpisodes(const Agent& agent, const std::string& agent_file,
                                       const std::string& path, Client& client);
  Status CopyInto(const std::string& path) const;
};

std::optional<Failure> WriteCommand::Prepare(Destination& destination,
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

// The given agent file, or a shipped behaviour policy's file, such as halfcheetah-medium.h5.
Result<std::string> WriteCommand::AgentPath() const {
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

std::optional<Failure> WriteCommand::Make() {
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

Result<CollectSummary> WriteCommand::WriteEpisodes(const Agent& agent,
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
  Agent behaviour = agent;  // may be the agent of another task with equal sizes
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

// Replaces the path of the removed copy, which the daemon read, by the original's in a message.
Status InTermsOf(const std::string& original, const std::string& copy, const Status& status) {
  std::string message = status.message();
  for (size_t at = 0; (at = message.find(copy, at)) != std::string::npos; at += original.size()) {
    message.replace(at, copy.size(), original);
  }
  return Status(status.code(), std::move(message));
}

// Whether the error is due to the file, so the daemon would refuse it again. Deadlines, interrupts
// and full queues are not.
bool LiesInFile(const Status& failure) {
  return failure.code() == StatusCode::kInvalidArgument ||
         failure.code() == StatusCode::kUnknownName || failure.code() == StatusCode::kDataLoss ||
         failure.code() == StatusCode::kVersionMismatch;
}

std::optional<Failure> WriteCommand::Import() {
  Destination destination;
  if (auto failure = Prepare(destination, "choose another --name or remove it")) return failure;
  if (Status status = CopyInto(destination.path); !status.ok()) return BadInput(std::move(status));
  const auto dataset = destination.connection->client().OpenDataset(name);
  if (!dataset.ok() && !LiesInFile(dataset.status())) {
    return BadInput(dataset.status().WithContext(fmt::format(
        "{} was copied to {}, where it stays, but not imported yet", file, destination.path)));
  }
  if (!dataset.ok()) {
    std::error_code ignored;  // a file that is no dataset must not stay under a dataset's name
    fs::remove(destination.path, ignored);
    return BadInput(InTermsOf(file, destination.path, dataset.status()));
  }
  fmt::print("{}: {} rows, sha256 {}\n", name, dataset->rows(),
             dataset->in_force().info().sha256());
  return std::nullopt;
}

Status WriteCommand::CopyInto(const std::string& path) const {
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

}  // namespace

std::vector<Command> AddDatasetWriters(CLI::App& group) {
  const auto make = std::make_shared<WriteCommand>(), import = std::make_shared<WriteCommand>();

  CLI::App* make_app = group.add_subcommand("make", "record episodes of a behaviour policy");
  make_app->add_option("name", make->name, "name of the new dataset: \"HalfCheetah/medium\"")
      ->required();
  make_app->add_option("--rows", make->rows, "transitions to record [1000000]")
      ->transform(Count(1, limits::kMaxDatasetRows));
  make_app->add_option("--seed", make->seed, "seed of the episodes' starts and of the actions [0]")
      ->transform(Seed());
  make_app->add_option("--agent", make->agent_path,
                       "agent file of the behaviour policy [the one shipped for the name]");
  make_app->add_flag("--replace", make->replace, "overwrite a dataset of that name");
  make_app->add_flag("--json", make->json, "print the result as JSON");

  CLI::App* import_app =
      group.add_subcommand("import", "check an HDF5 file in D4RL's layout and copy it in");
  import_app->add_option("file", import->file, "HDF5 file in D4RL's layout")->required();
  import_app->add_option("--name", import->name, "name of the new dataset: \"HalfCheetah/mine\"")
      ->required();

  for (const auto& [command, app] : {std::pair{make, make_app}, {import, import_app}}) {
    app->add_flag("--quiet", command->quiet, "show no progress on stderr");
    command->daemon.AddTo(*app);
  }
  return {{make_app, [make] { return make->Make(); }},
          {import_app, [import] { return import->Import(); }}};
}

}  // namespace b4mrl
