#include "data/d4rl/dataset_file_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// Rows of a chunk, equal for all columns, so that the file's layout depends on the rows alone.
constexpr uint64_t kChunkRows = 8192;

Status CheckSize(std::string_view name, size_t size, size_t rows, size_t width) {
  if (size == rows * width) return Status();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{} has {} elements, allowed: {} rows of {}", name, size, rows, width));
}

template <typename T>
std::span<const T> Piece(std::span<const T> all, size_t first, size_t rows, size_t width) {
  return all.subspan(first * width, rows * width);
}

}  // namespace

DatasetWriter::DatasetWriter(Hdf5Writer file, const DatasetWriterOptions& options)
    : file_(std::move(file)), options_(options) {}

Result<DatasetWriter> DatasetWriter::Create(const std::string& path,
                                            const DatasetWriterOptions& options) {
  if (options.observation_dimensions == 0 ||
      options.observation_dimensions > limits::kMaxObservationDimensions) {
    return InvalidNumber("observation_dimensions", options.observation_dimensions,
                         fmt::format("1..{}", limits::kMaxObservationDimensions));
  }
  if (options.action_dimensions == 0 || options.action_dimensions > limits::kMaxActionDimensions) {
    return InvalidNumber("action_dimensions", options.action_dimensions,
                         fmt::format("1..{}", limits::kMaxActionDimensions));
  }
  if (options.compression_level < 0 || options.compression_level > 9) {
    return InvalidNumber("compression_level", options.compression_level, "0..9");
  }
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file, Hdf5Writer::Create(path));
  DatasetWriter writer(std::move(file), options);
  B4MRL_RETURN_IF_ERROR(writer.CreateColumns());
  return writer;
}

Status DatasetWriter::CreateColumns() {
  const auto create = [this](std::string_view path, Hdf5Type type, uint64_t width,
                             Hdf5Writer::ColumnId* id) -> Status {
    B4MRL_ASSIGN_OR_RETURN(
        *id, file_.CreateColumn(path, {type, width, kChunkRows, options_.compression_level}));
    return Status();
  };
  const uint32_t observation = options_.observation_dimensions;
  constexpr Hdf5Type kFloat = Hdf5Type::kFloat32;
  B4MRL_RETURN_IF_ERROR(create("observations", kFloat, observation, &observations_));
  B4MRL_RETURN_IF_ERROR(create("actions", kFloat, options_.action_dimensions, &actions_));
  B4MRL_RETURN_IF_ERROR(create("next_observations", kFloat, observation, &next_observations_));
  B4MRL_RETURN_IF_ERROR(create("rewards", kFloat, 0, &rewards_));
  B4MRL_RETURN_IF_ERROR(create("terminals", Hdf5Type::kBool, 0, &terminals_));
  B4MRL_RETURN_IF_ERROR(create("timeouts", Hdf5Type::kBool, 0, &timeouts_));
  if (options_.action_log_probs) {
    B4MRL_RETURN_IF_ERROR(create("infos/action_log_probs", kFloat, 0, &log_probs_));
  }
  if (options_.qpos_dimensions > 0) {
    B4MRL_RETURN_IF_ERROR(
        create("infos/qpos", Hdf5Type::kFloat64, options_.qpos_dimensions, &qpos_));
  }
  if (options_.qvel_dimensions > 0) {
    B4MRL_RETURN_IF_ERROR(
        create("infos/qvel", Hdf5Type::kFloat64, options_.qvel_dimensions, &qvel_));
  }
  return Status();
}

Status DatasetWriter::CheckSizes(const DatasetRows& rows) const {
  const size_t n = rows.rows;
  const size_t observation = options_.observation_dimensions;
  B4MRL_RETURN_IF_ERROR(CheckSize("observations", rows.observations.size(), n, observation));
  B4MRL_RETURN_IF_ERROR(CheckSize("actions", rows.actions.size(), n, options_.action_dimensions));
  B4MRL_RETURN_IF_ERROR(
      CheckSize("next_observations", rows.next_observations.size(), n, observation));
  B4MRL_RETURN_IF_ERROR(CheckSize("rewards", rows.rewards.size(), n, 1));
  B4MRL_RETURN_IF_ERROR(CheckSize("terminals", rows.terminals.size(), n, 1));
  B4MRL_RETURN_IF_ERROR(CheckSize("timeouts", rows.timeouts.size(), n, 1));
  B4MRL_RETURN_IF_ERROR(CheckSize("action_log_probs", rows.action_log_probs.size(), n,
                                  options_.action_log_probs ? 1 : 0));
  B4MRL_RETURN_IF_ERROR(CheckSize("qpos", rows.qpos.size(), n, options_.qpos_dimensions));
  B4MRL_RETURN_IF_ERROR(CheckSize("qvel", rows.qvel.size(), n, options_.qvel_dimensions));
  if (n > limits::kMaxDatasetRows - rows_) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("a dataset holds at most {} rows", limits::kMaxDatasetRows));
  }
  return Status();
}

Status DatasetWriter::Append(const DatasetRows& rows) {
  B4MRL_RETURN_IF_ERROR(CheckSizes(rows));
  // Cut where chunks end: the order of chunks in the file must not show how rows were appended.
  for (size_t first = 0; first < rows.rows;) {
    const size_t count = std::min<size_t>(rows.rows - first, kChunkRows - rows_ % kChunkRows);
    const size_t observation = options_.observation_dimensions;
    DatasetRows piece;
    piece.rows = count;
    piece.observations = Piece(rows.observations, first, count, observation);
    piece.actions = Piece(rows.actions, first, count, options_.action_dimensions);
    piece.next_observations = Piece(rows.next_observations, first, count, observation);
    piece.rewards = Piece(rows.rewards, first, count, 1);
    piece.terminals = Piece(rows.terminals, first, count, 1);
    piece.timeouts = Piece(rows.timeouts, first, count, 1);
    piece.action_log_probs =
        Piece(rows.action_log_probs, first, count, options_.action_log_probs ? 1 : 0);
    piece.qpos = Piece(rows.qpos, first, count, options_.qpos_dimensions);
    piece.qvel = Piece(rows.qvel, first, count, options_.qvel_dimensions);
    B4MRL_RETURN_IF_ERROR(AppendPiece(piece));
    first += count;
  }
  return Status();
}

Status DatasetWriter::AppendPiece(const DatasetRows& rows) {
  B4MRL_RETURN_IF_ERROR(file_.Append(observations_, rows.observations));
  B4MRL_RETURN_IF_ERROR(file_.Append(actions_, rows.actions));
  B4MRL_RETURN_IF_ERROR(file_.Append(next_observations_, rows.next_observations));
  B4MRL_RETURN_IF_ERROR(file_.Append(rewards_, rows.rewards));
  B4MRL_RETURN_IF_ERROR(file_.Append(terminals_, rows.terminals));
  B4MRL_RETURN_IF_ERROR(file_.Append(timeouts_, rows.timeouts));
  if (options_.action_log_probs) {
    B4MRL_RETURN_IF_ERROR(file_.Append(log_probs_, rows.action_log_probs));
  }
  if (options_.qpos_dimensions > 0) B4MRL_RETURN_IF_ERROR(file_.Append(qpos_, rows.qpos));
  if (options_.qvel_dimensions > 0) B4MRL_RETURN_IF_ERROR(file_.Append(qvel_, rows.qvel));
  rows_ += rows.rows;
  return Status();
}

Status DatasetWriter::SetMetadata(std::string_view name, std::string_view text) {
  return file_.WriteString(fmt::format("metadata/{}", name), text);
}

Status DatasetWriter::SetMetadata(std::string_view name, int64_t value) {
  return file_.WriteInteger(fmt::format("metadata/{}", name), value);
}

Status DatasetWriter::SetPolicy(const Agent& agent) { return WriteAgentInto(file_, agent); }

Status DatasetWriter::Commit() { return file_.Commit(); }

}  // namespace b4mrl
