// b4mrl dataset export: the command that writes a dataset, as a daemon serves it, to files of other
// programs.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <utility>

#include "algorithms/base/progress.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "algorithms/tools/dataset_source.h"
#include "data/csv/dataset_csv_writer.h"
#include "data/d4rl/dataset_file_writer.h"
#include "data/files/atomic_file.h"
#include "data/minari/minari_id.h"
#include "data/minari/minari_writer.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

struct ExportCommand {
  DatasetSource source;
  std::string path, format = "d4rl", id;
  bool replace = false;

  std::optional<Failure> Run() const;
  Status WriteD4rl(RemoteDataset& dataset) const;
  Status WriteCsv(RemoteDataset& dataset) const;
  Status WriteMinari(Client& client, RemoteDataset& dataset) const;
  Existing IfExisting() const { return replace ? Existing::kReplace : Existing::kKeep; }
  // Calls `use` for all rows in order, in blocks; `stage` names the work in the progress.
  Status ForRows(RemoteDataset& dataset, std::string_view stage,
                 const std::function<Status(const DatasetRows&)>& use) const;
};

// How the rows were made, with what they were served with, for whoever reads the file alone.
std::string RecipeOf(const pb::OpenDatasetReply& source) {
  std::string recipe = source.provenance().recipe();
  const std::string corruptions = FormatNamedArguments(NamedArgumentsOf(source.corruptions()));
  if (!corruptions.empty()) {
    recipe += fmt::format("{}served from {} with {}, seed {}", recipe.empty() ? "" : "; ",
                          source.info().name(), corruptions, source.seed());
  }
  return recipe.substr(0, kMaxProvenanceText);
}

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
  provenance.recipe = RecipeOf(source);
  provenance.engine = said.engine();
  provenance.program = said.program();
  provenance.license = said.license();
  return provenance;
}

Status ExportCommand::ForRows(RemoteDataset& dataset, std::string_view stage,
                              const std::function<Status(const DatasetRows&)>& use) const {
  Progress progress(source.quiet);
  progress.Start(stage, "rows", dataset.rows());
  uint64_t done = 0;
  return ForEachRows(dataset, [&](const TransitionRows& served) -> Status {
    DatasetRows out;
    out.rows = served.rows;
    out.observations = served.observations;
    out.actions = served.actions;
    out.next_observations = served.next_observations;
    out.rewards = served.rewards;
    out.terminals = served.terminals;
    out.timeouts = served.timeouts;
    B4MRL_RETURN_IF_ERROR(use(out));
    progress.Update(done += served.rows);
    return Status();
  });
}

Status ExportCommand::WriteD4rl(RemoteDataset& dataset) const {
  DatasetWriterOptions options;
  options.observation_dimensions = static_cast<uint32_t>(dataset.observation_size());
  options.action_dimensions = static_cast<uint32_t>(dataset.action_size());
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  B4MRL_RETURN_IF_ERROR(
      ForRows(dataset, "export", [&](const DatasetRows& rows) { return writer.Append(rows); }));
  B4MRL_RETURN_IF_ERROR(writer.SetProvenance(ProvenanceOf(dataset)));
  const pb::OpenDatasetReply& served_from = dataset.in_force();
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source", served_from.info().name()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source_sha256", served_from.info().sha256()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata(
      "corruption", FormatNamedArguments(NamedArgumentsOf(served_from.corruptions()))));
  B4MRL_RETURN_IF_ERROR(
      writer.SetMetadata("corruption_seed", fmt::format("{}", served_from.seed())));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("transitions", served_from.transition_rule()));
  if (const std::string& policy = served_from.info().behaviour_policy(); !policy.empty()) {
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("behaviour_policy", policy));
  }
  return writer.Commit(IfExisting());
}

Status ExportCommand::WriteCsv(RemoteDataset& dataset) const {
  B4MRL_ASSIGN_OR_RETURN(
      DatasetCsvWriter writer,
      DatasetCsvWriter::Create(path, static_cast<uint32_t>(dataset.observation_size()),
                               static_cast<uint32_t>(dataset.action_size())));
  B4MRL_RETURN_IF_ERROR(
      ForRows(dataset, "export", [&](const DatasetRows& rows) { return writer.Append(rows); }));
  return writer.Commit(IfExisting());
}

std::string MinariIdOf(const RemoteDataset& dataset) {
  const pb::OpenDatasetReply& source = dataset.in_force();
  return MinariIdOf(ServedRows{.name = source.info().name(),
                               .corruptions = NamedArgumentsOf(source.corruptions()),
                               .corruption_seed = source.seed(),
                               .d4rl_transitions = source.transition_rule() == "d4rl"});
}

// Where the rows come from, in sentences.
std::string DescriptionOf(const RemoteDataset& dataset, bool last_is_unfinished) {
  const pb::OpenDatasetReply& source = dataset.in_force();
  const pb::DatasetProvenance& said = source.provenance();
  std::string text = fmt::format("The dataset {}, as B4MRL serves it.", source.info().name());
  const auto add = [&text](std::string_view what, std::string_view words) {
    if (!words.empty()) text += fmt::format(" {}: {}.", what, words);
  };
  add("Environment", source.environment());
  add("Perturbations while recording", said.simulator());
  add("Engine", said.engine());
  add("How the rows were made", said.recipe());
  add("Observation dimensions that the behaviour policy could not see or that are hidden",
      fmt::format("{}", fmt::join(source.hidden_dimensions(), ", ")));
  add("Corruptions", FormatNamedArguments(NamedArgumentsOf(source.corruptions())));
  if (source.seed() != 0) add("Seed of the corruptions' noise", fmt::format("{}", source.seed()));
  if (source.transition_rule() == "d4rl") {
    text +=
        " Rows that end by time-out were dropped, as d4rl.qlearning_dataset does, and the "
        "observation after a terminal one is the first of the next episode.";
  }
  add("Licence", said.license());
  if (last_is_unfinished) {
    text += " The rows end before the last episode does; its last row is marked as truncated.";
  }
  return text;
}

// A box without bounds.
SpaceSpec Unbounded(size_t size) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  SpaceSpec space;
  space.dimensions.resize(size, {.low = -kInfinity, .high = kInfinity});
  return space;
}

MinariDescription DescribeForMinari(Client& client, const RemoteDataset& dataset,
                                    bool last_is_unfinished) {
  const pb::OpenDatasetReply& source = dataset.in_force();
  MinariDescription description;
  description.metadata.algorithm = source.info().behaviour_policy();
  description.metadata.description = DescriptionOf(dataset, last_is_unfinished);
  description.metadata.provenance = ProvenanceOf(dataset);
  description.observation = Unbounded(dataset.observation_size());
  description.action = Unbounded(dataset.action_size());
  const auto environment = client.FindEnvironment(dataset.environment());
  if (environment.ok()) {  // the server has checked that the sizes are the environment's
    description.observation = environment->observation;
    description.action = environment->action;
    description.reference_min = environment->reference_min;
    description.reference_max = environment->reference_max;
  }
  if (source.provenance().program().starts_with("b4mrl ")) {  // which recorded the rows
    description.author = "The b4mrl server's contributors";
  }
  description.source = {
      {"source", source.info().name()},
      {"source_sha256", source.info().sha256()},
      {"source_columns_sha256", source.info().columns_sha256()},
      {"corruption", FormatNamedArguments(NamedArgumentsOf(source.corruptions()))},
      {"corruption_seed", fmt::format("{}", source.seed())},
      {"transitions", source.transition_rule()}};
  return description;
}

Status ExportCommand::WriteMinari(Client& client, RemoteDataset& dataset) const {
  const std::string name = id.empty() ? MinariIdOf(dataset) : id;
  const std::string folder = fmt::format("{}/{}", path, name);
  NewFolders folders;
  B4MRL_RETURN_IF_ERROR(folders.Make(FolderOf(folder)));
  B4MRL_RETURN_IF_ERROR(AtomicFolder::CheckAbsent(folder));
  EpisodeLengths episodes;
  B4MRL_RETURN_IF_ERROR(
      ForRows(dataset, "check", [&](const DatasetRows& rows) { return episodes.Append(rows); }));
  const MinariDescription description =
      DescribeForMinari(client, dataset, episodes.last_is_unfinished());
  B4MRL_ASSIGN_OR_RETURN(MinariWriter writer,
                         MinariWriter::Create(path, name, std::move(episodes)));
  B4MRL_RETURN_IF_ERROR(
      ForRows(dataset, "export", [&](const DatasetRows& rows) { return writer.Append(rows); }));
  B4MRL_RETURN_IF_ERROR(writer.Commit(description));
  fmt::print("{}: {} rows of {}, for minari.load_dataset(\"{}\")\n", folder, dataset.rows(),
             dataset.in_force().info().name(), name);
  return Status();
}

// Rows and episodes that Minari cannot hold and a folder that exists are faults of the input, not
// refusals of the daemon. A file that another process is writing is neither.
std::optional<Failure> FailureOf(Status status) {
  switch (status.code()) {
    case StatusCode::kOk:
      return std::nullopt;
    case StatusCode::kFailedPrecondition:
    case StatusCode::kLimitExceeded:
      return BadInput(std::move(status));
    case StatusCode::kBusy:
      return Failure{kExitBusy, std::move(status)};
    default:
      return FromDaemon(std::move(status));
  }
}

std::optional<Failure> ExportCommand::Run() const {
  if (!id.empty() && format != "minari") {
    return BadUsage(InvalidArgument("--id", id, "--format minari alone"));
  }
  if (!id.empty()) {
    if (Status status = CheckMinariId(id); !status.ok()) return BadUsage(std::move(status));
  }
  if (format == "minari" && replace) {
    return BadUsage(InvalidArgument("--replace", "given", "--format d4rl or csv alone"));
  }
  if (format != "minari") {
    if (auto failure = CheckOutputFile("path", path, replace)) return failure;
  }
  return source.Open([this](Client& client, RemoteDataset& dataset) -> std::optional<Failure> {
    if (format == "minari") return FailureOf(WriteMinari(client, dataset));
    Status status = format == "csv" ? WriteCsv(dataset) : WriteD4rl(dataset);
    if (!status.ok()) return FailureOf(std::move(status));
    fmt::print("{}: {} rows of {}\n", path, dataset.rows(), dataset.in_force().info().name());
    return std::nullopt;
  });
}

}  // namespace

std::vector<Command> AddDatasetExport(CLI::App& group) {
  const auto command = std::make_shared<ExportCommand>();
  CLI::App* app = group.add_subcommand(
      "export", "write a dataset, corrupted if asked, in D4RL's layout, for Minari or as CSV");
  command->source.AddTo(*app);
  app->add_option("path", command->path,
                  "file to write; with --format minari the root folder of Minari's datasets "
                  "(~/.minari/datasets or $MINARI_DATASETS_PATH)")
      ->required();
  app->add_option("--format", command->format,
                  "\"d4rl\": an HDF5 file in D4RL's layout; \"minari\": a folder that "
                  "minari.load_dataset opens; \"csv\": a table of text [d4rl]")
      ->check(CLI::IsMember({"d4rl", "minari", "csv"}));
  app->add_flag("--replace", command->replace, "replace a file that is there already");
  app->add_option("--id", command->id,
                  "Minari's id of the dataset, \"NAMESPACE/NAME-v0\" [\"b4mrl/\" and the "
                  "dataset's full name with its corruptions]");
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
