// b4mrl dataset export: the command that writes a dataset, as a daemon serves it, to a file.
#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "algorithms/base/progress.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_source.h"
#include "data/d4rl/dataset_file_writer.h"

namespace b4mrl {
namespace {

struct ExportCommand {
  DatasetSource source;
  std::string file;

  std::optional<Failure> Run() const;
  Status Write(RemoteDataset& dataset) const;
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

std::optional<Failure> ExportCommand::Run() const {
  return source.Open([this](Client&, RemoteDataset& dataset) -> std::optional<Failure> {
    if (Status status = Write(dataset); !status.ok()) return FromDaemon(std::move(status));
    fmt::print("{}: {} rows of {}\n", file, dataset.rows(), dataset.in_force().info().name());
    return std::nullopt;
  });
}

Status ExportCommand::Write(RemoteDataset& dataset) const {
  constexpr uint32_t kRowsPerRead = 16'384;
  DatasetWriterOptions options;
  options.observation_dimensions = static_cast<uint32_t>(dataset.observation_size());
  options.action_dimensions = static_cast<uint32_t>(dataset.action_size());
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(file, options));
  const uint32_t most = std::min(kRowsPerRead, dataset.max_rows_per_request());
  Progress progress(source.quiet);
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
  const pb::OpenDatasetReply& served_from = dataset.in_force();
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source", served_from.info().name()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source_sha256", served_from.info().sha256()));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("corruption", source.corruption));
  B4MRL_RETURN_IF_ERROR(
      writer.SetMetadata("corruption_seed", static_cast<int64_t>(served_from.seed())));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("transitions", served_from.transition_rule()));
  return writer.Commit();
}

}  // namespace

std::vector<Command> AddDatasetExport(CLI::App& group) {
  const auto command = std::make_shared<ExportCommand>();
  CLI::App* app = group.add_subcommand("export", "write a dataset, corrupted if asked, as HDF5");
  command->source.AddTo(*app);
  app->add_option("file", command->file, "HDF5 file to write")->required();
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
