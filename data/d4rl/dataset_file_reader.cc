#include "data/d4rl/dataset_file_reader.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

Result<std::optional<Hdf5Column>> OpenOptional(const Hdf5Reader& file, const char* path) {
  if (!file.Exists(path)) return std::optional<Hdf5Column>();
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column column, file.OpenColumn(path));
  return std::optional(std::move(column));
}

template <typename T>
Status ReadInto(const Hdf5Column& column, uint64_t first, uint64_t count, std::vector<T>* out) {
  out->resize(count * column.width());
  if constexpr (std::is_same_v<T, uint8_t>) {
    return column.ReadFlags(first, *out);
  } else {
    return column.Read(first, *out);
  }
}

}  // namespace

DatasetRows DatasetBlock::view() const {
  DatasetRows out;
  out.rows = rewards.size();
  out.observations = observations;
  out.actions = actions;
  out.next_observations = next_observations;
  out.rewards = rewards;
  out.terminals = terminals;
  out.timeouts = timeouts;
  out.qpos = qpos;
  out.qvel = qvel;
  return out;
}

DatasetFileReader::DatasetFileReader(Hdf5Column observations, Hdf5Column actions,
                                     Hdf5Column next_observations, Hdf5Column rewards,
                                     Hdf5Column terminals)
    : observations_(std::move(observations)),
      actions_(std::move(actions)),
      next_observations_(std::move(next_observations)),
      rewards_(std::move(rewards)),
      terminals_(std::move(terminals)) {}

Result<DatasetFileReader> DatasetFileReader::Open(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader file, Hdf5Reader::Open(path));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column observations, file.OpenColumn("observations"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column actions, file.OpenColumn("actions"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column next_observations, file.OpenColumn("next_observations"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column rewards, file.OpenColumn("rewards"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column terminals, file.OpenColumn("terminals"));
  DatasetFileReader reader(std::move(observations), std::move(actions),
                           std::move(next_observations), std::move(rewards), std::move(terminals));
  B4MRL_ASSIGN_OR_RETURN(reader.timeouts_, OpenOptional(file, "timeouts"));
  B4MRL_ASSIGN_OR_RETURN(reader.qpos_, OpenOptional(file, "infos/qpos"));
  B4MRL_ASSIGN_OR_RETURN(reader.qvel_, OpenOptional(file, "infos/qvel"));
  B4MRL_RETURN_IF_ERROR(reader.CheckSizes().WithContext(path));
  B4MRL_ASSIGN_OR_RETURN(reader.provenance_, ReadDatasetProvenance(file));
  const std::string first_episode = fmt::format("metadata/{}", kReplayFirstEpisode);
  if (!file.Exists(first_episode)) return reader;
  B4MRL_ASSIGN_OR_RETURN(const double episode, file.ReadNumber(first_episode));
  if (!(episode >= 0 && episode < limits::kMaxDatasetRows && episode == std::floor(episode))) {
    return InvalidNumber(first_episode, episode,
                         fmt::format("whole numbers in 0..{}", limits::kMaxDatasetRows - 1));
  }
  reader.first_episode_ = static_cast<uint64_t>(episode);
  return reader;
}

Status DatasetFileReader::CheckSizes() const {
  const auto check = [&](const Hdf5Column& column, uint64_t width, uint64_t most) {
    if (column.rows() == rows() && column.width() == width && width <= most) return Status();
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} has {} rows of {}, allowed: {} rows of {}, at most {}",
                              column.path(), column.rows(), column.width(), rows(), width, most));
  };
  if (rows() == 0 || rows() > limits::kMaxDatasetRows) {
    return InvalidNumber("rows", rows(), fmt::format("1..{}", limits::kMaxDatasetRows));
  }
  constexpr uint64_t kMostObservations = limits::kMaxObservationDimensions;
  B4MRL_RETURN_IF_ERROR(check(observations_, observation_size(), kMostObservations));
  B4MRL_RETURN_IF_ERROR(check(next_observations_, observation_size(), kMostObservations));
  B4MRL_RETURN_IF_ERROR(check(actions_, action_size(), limits::kMaxActionDimensions));
  for (const Hdf5Column* column : {&rewards_, &terminals_, timeouts_ ? &*timeouts_ : nullptr}) {
    if (column != nullptr) B4MRL_RETURN_IF_ERROR(check(*column, 1, 1));
  }
  for (const auto* column : {&qpos_, &qvel_}) {
    if (*column) B4MRL_RETURN_IF_ERROR(check(**column, (*column)->width(), kMostObservations));
  }
  return Status();
}

Result<DatasetBlock> DatasetFileReader::Read(uint64_t first, uint64_t count) const {
  DatasetBlock block;
  B4MRL_RETURN_IF_ERROR(ReadInto(observations_, first, count, &block.observations));
  B4MRL_RETURN_IF_ERROR(ReadInto(actions_, first, count, &block.actions));
  B4MRL_RETURN_IF_ERROR(ReadInto(next_observations_, first, count, &block.next_observations));
  B4MRL_RETURN_IF_ERROR(ReadInto(rewards_, first, count, &block.rewards));
  B4MRL_RETURN_IF_ERROR(ReadInto(terminals_, first, count, &block.terminals));
  block.timeouts.resize(count);
  if (timeouts_) B4MRL_RETURN_IF_ERROR(ReadInto(*timeouts_, first, count, &block.timeouts));
  if (!has_states()) return block;
  B4MRL_RETURN_IF_ERROR(ReadInto(*qpos_, first, count, &block.qpos));
  B4MRL_RETURN_IF_ERROR(ReadInto(*qvel_, first, count, &block.qvel));
  return block;
}

}  // namespace b4mrl
