// b4mrl dataset import: the command that copies files of others into a daemon's data folder.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <memory>
#include <system_error>
#include <vector>

#include "algorithms/datasets/import_name.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/dataset_place.h"
#include "algorithms/tools/minari_import.h"
#include "client/interrupt.h"
#include "data/files/atomic_file.h"
#include "data/minari/minari_reader.h"
#include "proto/base/names.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

struct ImportCommand {
  std::string name, file, d4rl_folder;
  bool quiet = false;
  DaemonOptions daemon;

  std::optional<Failure> Run() const;
  // What can be said of --name before there is a daemon.
  Status CheckName() const;
  // Imports every file of D4RL in d4rl_folder that the data folder does not have. A file that
  // cannot be imported is reported and does not keep the others back.
  std::optional<Failure> ImportFolder(Destination& destination) const;
  // A file that another import left there need not be a dataset.
  std::optional<Failure> CheckPresent(const std::string& dataset, Destination& destination) const;
  std::optional<Failure> ImportFile(const std::string& source, const std::string& dataset,
                                    Destination& destination) const;
};

// A file of D4RL and the name of the dataset that it becomes.
struct D4rlFile {
  std::string path, dataset;
};

// The files of `folder` that have a name of D4RL for one of the daemon's environments, by name.
Result<std::vector<D4rlFile>> D4rlFilesIn(const std::string& folder, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue, client.Catalogue());
  std::vector<D4rlFile> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string dataset = D4rlDatasetName(entry->path().filename());
    const bool known = std::ranges::any_of(catalogue.environments(), [&](const auto& environment) {
      return dataset.starts_with(fmt::format("d4rl/{}-", LowerCase(environment.name())));
    });
    if (known) files.push_back({entry->path(), dataset});
  }
  if (error) return IoError("list", folder, error.value());
  std::ranges::sort(files, {}, &D4rlFile::dataset);
  return files;
}

// The daemon's environment that a dataset's name belongs to, or "" (import_name.h).
Result<std::string> EnvironmentOfName(const std::string& dataset, Client& client) {
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue, client.Catalogue());
  std::vector<std::string> known;
  for (const pb::EnvironmentInfo& environment : catalogue.environments()) {
    known.push_back(environment.name());
  }
  return EnvironmentOfImport(dataset, known);
}

// Opens a dataset whose name belongs to `environment`, or to none. kInvalidArgument if the file
// says that its rows are of another one: the name would hide this from its readers.
Result<RemoteDataset> OpenImported(const std::string& dataset, const std::string& environment,
                                   Client& client) {
  B4MRL_ASSIGN_OR_RETURN(RemoteDataset opened, client.OpenDataset(dataset, {}));
  if (environment.empty() || opened.environment() == environment) return opened;
  return InvalidArgument("dataset", dataset,
                         fmt::format("a name that is not of {}, since the file says that its rows "
                                     "were recorded in {}",
                                     environment, opened.environment()));
}

// Says what is odd about the rows of an imported dataset, which may be meant so.
Status TellOddRows(Client& client, RemoteDataset& dataset) {
  const auto environment = client.FindEnvironment(dataset.environment());  // "" is none
  const SpaceSpec space = environment.ok() ? environment->action : SpaceSpec();
  B4MRL_ASSIGN_OR_RETURN(const OddRows odd, CountOddRows(dataset, space));
  if (odd.nonfinite > 0) {
    fmt::print(stderr, "{} of {} rows hold a NaN or an infinity: `b4mrl train` refuses them\n",
               odd.nonfinite, dataset.rows());
  }
  if (odd.outside > 0) {
    fmt::print(stderr, "{} of {} rows have actions outside of {}'s bounds\n", odd.outside,
               dataset.rows(), dataset.environment());
  }
  return Status();
}

// Replaces the path of the removed copy, which the daemon read, by the original's in a message.
Status InTermsOf(const std::string& original, const std::string& copy, const Status& status) {
  std::string message = status.message();
  for (size_t at = 0; (at = message.find(copy, at)) != std::string::npos; at += original.size()) {
    message.replace(at, copy.size(), original);
  }
  return Status(status.code(), std::move(message));
}

// Whether the error is due to the file, or to rows of other sizes than those of the environment
// that its name belongs to, so the daemon would refuse it again. Deadlines, interrupts and full
// queues are not.
bool LiesInFile(const Status& failure) {
  return failure.code() == StatusCode::kInvalidArgument ||
         failure.code() == StatusCode::kUnknownName || failure.code() == StatusCode::kDataLoss ||
         failure.code() == StatusCode::kVersionMismatch ||
         failure.code() == StatusCode::kFailedPrecondition;  // of another size than its task
}

// Copies what is stored of the first `size` bytes; holes stay holes.
Status CopyData(int in, off_t size, const std::string& file, AtomicFile* out) {
  std::vector<char> block(1 << 20);
  for (off_t at = 0; at < size;) {
    if (Interrupted()) return Status(StatusCode::kUnavailable, "interrupted");
    const off_t data = lseek(in, at, SEEK_DATA);
    if (data < 0 && errno == ENXIO) return Status();  // a hole up to the end
    at = std::max(at, data);  // file systems that know of no holes have data everywhere
    const auto most = static_cast<size_t>(std::min<off_t>(size - at, block.size()));
    const ssize_t count = pread(in, block.data(), most, at);
    if (count < 0) return IoError("read", file, errno);
    if (count == 0) return Status(StatusCode::kDataLoss, fmt::format("{} became shorter", file));
    if (lseek(out->fd(), at, SEEK_SET) < 0) return IoError("write", out->path(), errno);
    B4MRL_RETURN_IF_ERROR(out->Write({block.data(), static_cast<size_t>(count)}));
    at += count;
  }
  return Status();
}

Status Copy(const std::string& file, const std::string& path) {
  if (std::error_code error; fs::is_directory(file, error)) {
    return InvalidArgument("file", file,
                           "an HDF5 file, or the folder of a Minari dataset, which has a file "
                           "data/metadata.json");
  }
  // Opening a pipe would wait for whoever writes into it.
  const UniqueFd in(open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info {};
  if (!in.valid() || fstat(in.get(), &info) != 0) return IoError("read", file, errno);
  if (!S_ISREG(info.st_mode)) return InvalidArgument("file", file, "a regular file");
  B4MRL_ASSIGN_OR_RETURN(AtomicFile out, AtomicFile::Create(path));
  B4MRL_RETURN_IF_ERROR(CopyData(in.get(), info.st_size, file, &out));
  if (ftruncate(out.fd(), info.st_size) != 0) return IoError("extend", path, errno);
  return out.Commit(Existing::kKeep);
}

std::optional<Failure> ImportCommand::Run() const {
  if (file.empty() && d4rl_folder.empty()) {
    return BadUsage(Status(StatusCode::kInvalidArgument,
                           "nothing to import: give a file and its --name, or --d4rl DIR"));
  }
  if (Status status = CheckName(); !status.ok()) return BadInput(std::move(status));
  Destination destination;
  if (auto failure = destination.Open(daemon)) return failure;
  return d4rl_folder.empty() ? ImportFile(file, name, destination) : ImportFolder(destination);
}

Status ImportCommand::CheckName() const {
  if (file.empty()) return Status();  // the files of a folder have names of their own
  B4MRL_RETURN_IF_ERROR(ParseDatasetName(name).status());
  return CheckIsNoLevel(name);
}

std::optional<Failure> ImportCommand::ImportFolder(Destination& destination) const {
  const auto files = D4rlFilesIn(d4rl_folder, destination.client());
  if (!files.ok()) return BadInput(files.status());
  if (files->empty()) {
    return BadInput(Status(
        StatusCode::kUnknownName,
        fmt::format("{} has no file of D4RL for an environment of the daemon; their names are "
                    "those of D4RL, as halfcheetah_medium_replay-v2.hdf5",
                    d4rl_folder)));
  }
  std::optional<Failure> first;
  size_t failed = 0;
  for (const D4rlFile& found : *files) {
    auto failure = destination.Has(found.dataset)
                       ? CheckPresent(found.dataset, destination)
                       : ImportFile(found.path, found.dataset, destination);
    if (!failure) continue;
    if (Interrupted()) return failure;
    fmt::print(stderr, "{}: {}\n", found.dataset, failure->status.message());
    ++failed;
    if (!first) first = std::move(failure);
  }
  if (!first) return std::nullopt;
  return Failure{first->exit_code,
                 Status(first->status.code(),
                        fmt::format("{} of {} files were not imported", failed, files->size()))};
}

std::optional<Failure> ImportCommand::CheckPresent(const std::string& dataset,
                                                   Destination& destination) const {
  const auto opened = destination.client().OpenDataset(dataset, {});
  if (!opened.ok()) return BadInput(opened.status().WithContext("is there, but cannot be opened"));
  if (!quiet) fmt::print(stderr, "{}: is there already\n", dataset);
  return std::nullopt;
}

std::optional<Failure> ImportCommand::ImportFile(const std::string& source,
                                                 const std::string& dataset,
                                                 Destination& destination) const {
  const auto environment = EnvironmentOfName(dataset, destination.client());
  if (!environment.ok()) return FromDaemon(environment.status());
  if (auto failure =
          destination.Prepare(dataset, /*replace=*/false, "choose another --name or remove it")) {
    return failure;
  }
  const auto minari = FindMinariData(source);
  Status status = minari ? ConvertMinari(*minari, destination.path(), destination.client(), quiet)
                               .WithContext(source)
                         : Copy(source, destination.path());
  if (!status.ok()) return BadInput(std::move(status));
  auto opened = OpenImported(dataset, *environment, destination.client());
  if (!opened.ok() && !LiesInFile(opened.status()) && !Interrupted()) {
    return BadInput(opened.status().WithContext(fmt::format(
        "{} was copied to {}, where it stays, but not imported yet", source, destination.path())));
  }
  if (!opened.ok()) {
    // A file that is no dataset, or was not checked, must not stay under a dataset's name.
    std::error_code ignored;
    fs::remove(destination.path(), ignored);
    return BadInput(InTermsOf(source, destination.path(), opened.status()));
  }
  fmt::print("{}: {} rows, sha256 {}\n", dataset, opened->rows(),
             opened->in_force().info().sha256());
  const Status told = TellOddRows(destination.client(), *opened);
  if (!told.ok()) return FromDaemon(told);
  return std::nullopt;
}

}  // namespace

std::vector<Command> AddDatasetImport(CLI::App& group) {
  const auto command = std::make_shared<ImportCommand>();
  CLI::App* app = group.add_subcommand("import", "check datasets of others and copy them in");
  auto* file = app->add_option("file", command->file,
                               "HDF5 file in D4RL's layout, or folder of a Minari dataset");
  auto* name =
      app->add_option("--name", command->name, "name of the new dataset: \"HalfCheetah/mine\"");
  app->add_option("--d4rl", command->d4rl_folder,
                  "folder of D4RL's own files, as ~/.d4rl/datasets; those of known environments "
                  "become d4rl/halfcheetah-medium-v2 and so on")
      ->excludes(file)
      ->excludes(name);
  file->needs(name);
  name->needs(file);
  app->add_flag("--quiet", command->quiet, "show no progress on stderr");
  command->daemon.AddTo(*app);
  return {{app, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
