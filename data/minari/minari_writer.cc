#include "data/minari/minari_writer.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <utility>
#include <vector>

#include "data/files/atomic_file.h"
#include "data/minari/minari_id.h"

namespace b4mrl {
namespace {

constexpr char kNamespaceFile[] = "namespace_metadata.json";

template <typename T>
std::span<const T> RowsOf(std::span<const T> values, size_t rows, size_t first, size_t count) {
  const size_t width = values.size() / rows;
  return values.subspan(first * width, count * width);
}

}  // namespace

MinariWriter::MinariWriter(std::string root, std::string id, EpisodeLengths episodes,
                           AtomicFolder folder, Hdf5Writer file)
    : root_(std::move(root)),
      id_(std::move(id)),
      episodes_(std::move(episodes)),
      folder_(std::move(folder)),
      file_(std::move(file)) {}

Result<MinariWriter> MinariWriter::Create(const std::string& root, const std::string& id,
                                          EpisodeLengths episodes) {
  B4MRL_RETURN_IF_ERROR(CheckMinariId(id));
  B4MRL_ASSIGN_OR_RETURN(AtomicFolder folder, AtomicFolder::Create(fmt::format("{}/{}", root, id)));
  const std::string data = folder.temporary_path() + "/data";
  if (mkdir(data.c_str(), 0777) != 0) return IoError("create folder", data, errno);
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file,
                         Hdf5Writer::Create(fmt::format("{}/{}", data, kMinariDataFile)));
  return MinariWriter(root, id, std::move(episodes), std::move(folder), std::move(file));
}

Status MinariWriter::BeginEpisode(uint64_t observation_size, uint64_t action_size) {
  const uint64_t rows = episodes_.lengths()[episode_];
  const std::string group = fmt::format("episode_{}", episode_);
  const auto create = [&](std::string_view name, Hdf5Type type, std::vector<uint64_t> shape) {
    return file_.CreateArray(fmt::format("{}/{}", group, name), type, shape);
  };
  using enum Hdf5Type;
  B4MRL_RETURN_IF_ERROR(create("observations", kFloat32, {rows + 1, observation_size}));
  B4MRL_RETURN_IF_ERROR(create("actions", kFloat32, {rows, action_size}));
  B4MRL_RETURN_IF_ERROR(create("rewards", kFloat32, {rows}));
  B4MRL_RETURN_IF_ERROR(create("terminations", kBool, {rows}));
  B4MRL_RETURN_IF_ERROR(create("truncations", kBool, {rows}));
  // Minari prints no episode without infos.
  B4MRL_RETURN_IF_ERROR(file_.CreateGroup(group + "/infos"));
  B4MRL_RETURN_IF_ERROR(file_.WriteAttribute(group, "id", static_cast<int64_t>(episode_)));
  return file_.WriteAttribute(group, "total_steps", static_cast<int64_t>(rows));
}

Status MinariWriter::Append(const DatasetRows& rows) {
  if (rows.rows > episodes_.rows() - rows_) {
    return InvalidNumber("rows", static_cast<double>(rows_ + rows.rows),
                         fmt::format("the {} rows of the episodes", episodes_.rows()));
  }
  for (size_t row = 0; row < rows.rows;) {
    if (row_in_episode_ == 0) {
      B4MRL_RETURN_IF_ERROR(
          BeginEpisode(rows.observations.size() / rows.rows, rows.actions.size() / rows.rows));
    }
    const uint64_t left = episodes_.lengths()[episode_] - row_in_episode_;
    const auto count = static_cast<size_t>(std::min<uint64_t>(left, rows.rows - row));
    const auto write = [&](std::string_view name, auto values) {
      return file_.WriteRows(fmt::format("episode_{}/{}", episode_, name), row_in_episode_,
                             RowsOf(values, rows.rows, row, count));
    };
    B4MRL_RETURN_IF_ERROR(write("observations", rows.observations));
    B4MRL_RETURN_IF_ERROR(write("actions", rows.actions));
    B4MRL_RETURN_IF_ERROR(write("rewards", rows.rewards));
    B4MRL_RETURN_IF_ERROR(write("terminations", rows.terminals));
    B4MRL_RETURN_IF_ERROR(write("truncations", rows.timeouts));
    row += count;
    row_in_episode_ += count;
    rows_ += count;
    if (count < left) continue;
    B4MRL_RETURN_IF_ERROR(file_.WriteRows(fmt::format("episode_{}/observations", episode_),
                                          row_in_episode_,
                                          RowsOf(rows.next_observations, rows.rows, row - 1, 1)));
    ++episode_;
    row_in_episode_ = 0;
  }
  return Status();
}

Status MinariWriter::WriteNamespaces() const {
  for (const std::string& name : MinariNamespaces(id_)) {
    const std::string file = fmt::format("{}/{}/{}", root_, name, kNamespaceFile);
    if (std::error_code error; std::filesystem::exists(file, error)) continue;
    const Status written = WriteSmallFile(file, "{}");
    // Another export is writing the same file.
    if (!written.ok() && written.code() != StatusCode::kBusy) return written;
  }
  return Status();
}

Status MinariWriter::Commit(MinariDescription description) {
  if (rows_ != episodes_.rows()) {
    return InvalidNumber("rows", static_cast<double>(rows_),
                         fmt::format("the {} rows of the episodes", episodes_.rows()));
  }
  description.metadata.id = id_;
  description.metadata.episodes = episodes_.lengths().size();
  description.metadata.rows = rows_;
  description.metadata.last_is_unfinished = episodes_.last_is_unfinished();
  if (episodes_.last_is_unfinished()) {
    constexpr std::array<uint8_t, 1> kTruncated = {1};
    B4MRL_RETURN_IF_ERROR(
        file_.WriteRows(fmt::format("episode_{}/truncations", episodes_.lengths().size() - 1),
                        episodes_.lengths().back() - 1, kTruncated));
  }
  B4MRL_RETURN_IF_ERROR(file_.Commit());
  std::error_code error;
  const uint64_t bytes = std::filesystem::file_size(DataFolder() + "/" + kMinariDataFile, error);
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(DataFolder() + "/" + kMinariMetadataFile,
                                       MinariMetadataText(description, error ? 0 : bytes)));
  B4MRL_RETURN_IF_ERROR(WriteNamespaces());
  return folder_.Commit();
}

}  // namespace b4mrl
