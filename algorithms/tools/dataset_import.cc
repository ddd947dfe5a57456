// b4mrl dataset import: the command that copies a file of others into a daemon's data folder.
#include <fmt/format.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <memory>
#include <system_error>

#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "client/interrupt.h"
#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

struct ImportCommand {
  std::string name, file, transitions = "stored";
  bool quiet = false;
  DaemonOptions daemon;

  std::optional<Failure> Run();
  Status CopyInto(const std::string& path) const;
};

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

std::optional<Failure> ImportCommand::Run() {
  Destination destination;
  if (auto failure = destination.Open(daemon)) return failure;
  if (auto failure =
          destination.Prepare(name, /*replace=*/false, "choose another --name or remove it")) {
    return failure;
  }
  if (Status status = CopyInto(destination.path()); !status.ok())
    return BadInput(std::move(status));
  DatasetOptions options;
  options.transition_rule = transitions;
  const auto dataset = destination.client().OpenDataset(name, options);
  if (!dataset.ok() && !LiesInFile(dataset.status())) {
    return BadInput(dataset.status().WithContext(fmt::format(
        "{} was copied to {}, where it stays, but not imported yet", file, destination.path())));
  }
  if (!dataset.ok()) {
    std::error_code ignored;  // a file that is no dataset must not stay under a dataset's name
    fs::remove(destination.path(), ignored);
    return BadInput(InTermsOf(file, destination.path(), dataset.status()));
  }
  fmt::print("{}: {} rows, sha256 {}\n", name, dataset->rows(),
             dataset->in_force().info().sha256());
  return std::nullopt;
}

Status ImportCommand::CopyInto(const std::string& path) const {
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

std::vector<Command> AddDatasetImport(CLI::App& group) {
  const auto command = std::make_shared<ImportCommand>();
  CLI::App* app =
      group.add_subcommand("import", "check an HDF5 file in D4RL's layout and copy it in");
  app->add_option("file", command->file, "HDF5 file in D4RL's layout")->required();
  app->add_option("--name", command->name, "name of the new dataset: \"HalfCheetah/mine\"")
      ->required();
  AddTransitions(*app, command->transitions);
  app->add_flag("--quiet", command->quiet, "show no progress on stderr");
  command->daemon.AddTo(*app);
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
