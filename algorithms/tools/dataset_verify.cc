// b4mrl dataset verify: steps the rows of a dataset file again.
//
// The file is opened by this process, as agent files are, with the reader that distrusts its file
// (data/hdf5/hdf5_file.h) but without the importer's sandbox.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <utility>

#include "algorithms/base/progress.h"
#include "algorithms/episodes/verify.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "data/d4rl/dataset_file_reader.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

struct VerifyCommand {
  std::string file, environment;
  bool quiet = false;
  bool json = false;
  DaemonOptions daemon;

  std::optional<Failure> Run();
  // Connects to the daemon unless that has been done.
  std::optional<Failure> Connect(std::optional<DaemonConnection>& connection) const;
  // Replaces the name of a dataset by the file that the daemon serves under it.
  std::optional<Failure> FindFile(std::optional<DaemonConnection>& connection);
  std::optional<Failure> Recording(const DatasetFileReader& reader, Client& client) const;
  std::optional<Failure> States(const DatasetFileReader& reader, Client& client) const;
  void PrintJson(const Json& out) const {
    fmt::print("{}\n", out.dump(-1, ' ', false, Json::error_handler_t::replace));
  }
};

std::optional<Failure> VerifyCommand::Connect(std::optional<DaemonConnection>& connection) const {
  if (connection) return std::nullopt;
  auto opened = DaemonConnection::Open(daemon);
  if (!opened.ok()) return FromDaemon(opened.status());
  connection.emplace(*std::move(opened));
  return std::nullopt;
}

std::optional<Failure> VerifyCommand::FindFile(std::optional<DaemonConnection>& connection) {
  std::error_code unknown;  // what cannot be looked at is no file to read either
  if (std::filesystem::exists(file, unknown) || !ParseDatasetName(file).ok()) return std::nullopt;
  if (auto failure = Connect(connection)) return failure;
  const auto served = connection->client().OpenDataset(file);
  if (!served.ok()) return FromDataset(served.status(), file);
  const auto folder = connection->DataFolder();
  if (!folder.ok()) return FromDaemon(folder.status());
  const auto name = ParseDatasetName(served->in_force().info().name());  // with its version
  if (!name.ok()) return BadInput(name.status());
  file = DatasetPath(*folder, *name);
  return std::nullopt;
}

// What the daemon refuses to open, to restore or to step is what the file says.
Failure VerifyFailure(const Status& status) {
  const bool is_of_file = status.code() == StatusCode::kInvalidArgument ||
                          status.code() == StatusCode::kUnknownName ||
                          status.code() == StatusCode::kUnsupported;
  return is_of_file ? BadInput(status) : FromDaemon(status);
}

std::optional<Failure> VerifyCommand::Run() {
  std::optional<DaemonConnection> connection;
  if (auto failure = FindFile(connection)) return failure;
  const auto reader = DatasetFileReader::Open(file);
  if (!reader.ok()) return BadInput(reader.status());
  const bool is_recording = !reader->provenance().parts.empty();
  if (!is_recording && !reader->has_states()) {
    return BadInput(
        Status(StatusCode::kUnsupported,
               fmt::format("{} names no seeds of its episodes and has no infos/qpos and "
                           "infos/qvel, so its rows cannot be stepped again",
                           file)));
  }
  if (is_recording && !environment.empty()) {
    return BadUsage(InvalidArgument("--environment", environment,
                                    "nothing for a recording, which names its environment"));
  }
  if (auto failure = Connect(connection)) return failure;
  return is_recording ? Recording(*reader, connection->client())
                      : States(*reader, connection->client());
}

std::optional<Failure> VerifyCommand::Recording(const DatasetFileReader& reader,
                                                Client& client) const {
  Progress progress(quiet);
  const auto difference = VerifyRecording(reader, client, progress);
  if (!difference.ok()) return VerifyFailure(difference.status().WithContext(file));
  const bool is_equal = !difference->has_value();
  const uint64_t equal_rows = is_equal ? reader.rows() : (*difference)->row;
  if (json) {
    Json out = {{"file", file},
                {"rows", reader.rows()},
                {"equal_rows", equal_rows},
                {"recorded_with", reader.provenance().engine},
                {"stepped_with", client.hello().engine_version()}};
    if (!is_equal) {
      const RowDifference& first = **difference;
      out["column"] = first.column;
      out["stored"] = first.stored;
      out["stepped"] = first.stepped;
    }
    PrintJson(out);
  } else if (is_equal) {
    fmt::print(
        "{}: all {} rows are equal, bit for bit, in all columns but infos/action_log_probs\n", file,
        equal_rows);
  }
  if (is_equal) return std::nullopt;
  const RowDifference& first = **difference;
  return Failure{
      kExitFailed,
      Status(StatusCode::kDataLoss,
             fmt::format("{}: row {} of {} is the first that differs: {} is {:.9g}, and "
                         "{:.9g} when it is stepped again (rows count from 0; recorded "
                         "with {}, stepped with {})",
                         file, first.row, reader.rows(), first.column, first.stored, first.stepped,
                         reader.provenance().engine, client.hello().engine_version()))};
}

Json JsonOf(const Deviation& deviation) {
  return {{"median", deviation.median},
          {"p99", deviation.p99},
          {"largest", deviation.largest},
          {"largest_row", deviation.largest_row}};
}

std::optional<Failure> VerifyCommand::States(const DatasetFileReader& reader,
                                             Client& client) const {
  const std::string task = environment.empty() ? reader.provenance().environment : environment;
  if (task.empty()) {
    return BadUsage(InvalidArgument("--environment", "", "the environment of the file's rows"));
  }
  if (!environment.empty()) {  // else the file names it
    const auto known = client.FindEnvironment(task);
    if (!known.ok()) return FromDaemon(known.status());
  }
  Progress progress(quiet);
  const auto compared = CompareStates(reader, task, client, progress);
  if (!compared.ok()) return VerifyFailure(compared.status().WithContext(file));
  const std::pair<const char*, const Deviation*> columns[] = {
      {"observations", &compared->observations},
      {"next_observations", &compared->next_observations},
      {"rewards", &compared->rewards}};
  if (json) {
    Json out = {{"file", file},
                {"environment", task},
                {"rows", compared->rows},
                {"failed_rows", compared->failed_rows}};
    for (const auto& [name, deviation] : columns) out[name] = JsonOf(*deviation);
    PrintJson(out);
    return std::nullopt;
  }
  fmt::print("{}: {} rows, each stepped from its own infos/qpos and infos/qvel in {}; {} failed\n",
             file, compared->rows, task, compared->failed_rows);
  for (const auto& [name, deviation] : columns) {
    fmt::print(
        "{:<18} absolute difference: median {:.3g}, 99% below {:.3g}, largest {:.3g} (row {})\n",
        name, deviation->median, deviation->p99, deviation->largest, deviation->largest_row);
  }
  return std::nullopt;
}

}  // namespace

std::vector<Command> AddDatasetVerify(CLI::App& group) {
  const auto command = std::make_shared<VerifyCommand>();
  CLI::App* app = group.add_subcommand(
      "verify",
      "step a dataset file again from its seeds and actions and name the first row that differs "
      "(code 1); of a file of others, by how much rows differ from steps out of infos/qpos, qvel");
  app->add_option("file", command->file,
                  "HDF5 file in D4RL's layout, or the name of a dataset: \"HalfCheetah/medium\"")
      ->required();
  app->add_option("--environment", command->environment,
                  "environment of a file of others [the one that its metadata names]");
  app->add_flag("--json", command->json, "print the result as JSON");
  app->add_flag("--quiet", command->quiet, "show no progress on stderr");
  command->daemon.AddTo(*app);
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
