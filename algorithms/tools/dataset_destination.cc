#include "algorithms/tools/dataset_destination.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>
#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {

std::optional<Failure> Destination::Open(const DaemonOptions& daemon) {
  if (!daemon.data_folder.empty()) {
    if (Status status = folders_.Make(daemon.data_folder); !status.ok()) {
      return BadInput(std::move(status));
    }
  }
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  connection_.emplace(*std::move(connection));
  auto data_folder = connection_->DataFolder();
  if (!data_folder.ok()) return FromDaemon(data_folder.status());
  data_folder_ = *std::move(data_folder);
  return std::nullopt;
}

std::optional<Failure> Destination::Prepare(const std::string& name, bool replace,
                                            std::string_view advice) {
  const auto parts = ParseDatasetName(name);
  if (!parts.ok()) return BadInput(parts.status());
  path_ = DatasetPath(data_folder_, *parts);
  if (std::error_code error; !replace && std::filesystem::exists(path_, error)) {
    return BadInput(
        Status(StatusCode::kFailedPrecondition, fmt::format("{} exists; {}", path_, advice)));
  }
  if (Status status = folders_.Make(FolderOf(path_)); !status.ok()) {
    return BadInput(std::move(status));
  }
  return std::nullopt;
}

}  // namespace b4mrl
