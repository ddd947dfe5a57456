#include "data/d4rl/dataset_file_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
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
struct FileColumn {
  std::string_view path;
  Hdf5Type type;
  std::span<const T> DatasetRows::*values;
  size_t (*width)(const DatasetWriterOptions& options);  // elements of a row; 0: no column
  bool has_width = false;                                // whether the array has two dimensions
};

constexpr size_t One(const DatasetWriterOptions&) { return 1; }
constexpr size_t ObservationSize(const DatasetWriterOptions& options) {
  return options.observation_dimensions;
}

// The columns in their order in the file; another order would give a file of other bytes.
constexpr std::tuple kColumns = {
    FileColumn<float>{"observations", Hdf5Type::kFloat32, &DatasetRows::observations,
                      ObservationSize, true},
    FileColumn<float>{"actions", Hdf5Type::kFloat32, &DatasetRows::actions,
                      [](const auto& options) { return size_t{options.action_dimensions}; }, true},
    FileColumn<float>{"next_observations", Hdf5Type::kFloat32, &DatasetRows::next_observations,
                      ObservationSize, true},
    FileColumn<float>{"rewards", Hdf5Type::kFloat32, &DatasetRows::rewards, One},
    FileColumn<uint8_t>{"terminals", Hdf5Type::kBool, &DatasetRows::terminals, One},
    FileColumn<uint8_t>{"timeouts", Hdf5Type::kBool, &DatasetRows::timeouts, One},
    FileColumn<float>{"infos/action_log_probs", Hdf5Type::kFloat32, &DatasetRows::action_log_probs,
                      [](const auto& options) { return size_t{options.action_log_probs}; }},
    FileColumn<double>{"infos/qpos", Hdf5Type::kFloat64, &DatasetRows::qpos,
                       [](const auto& options) { return size_t{options.qpos_dimensions}; }, true},
    FileColumn<double>{"infos/qvel", Hdf5Type::kFloat64, &DatasetRows::qvel,
                       [](const auto& options) { return size_t{options.qvel_dimensions}; }, true},
};

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
  return VisitColumns(kColumns, [this](const auto& column, size_t number) -> Status {
    const size_t width = column.width(options_);
    if (width == 0) return Status();
    B4MRL_ASSIGN_OR_RETURN(
        ids_[number], file_.CreateColumn(column.path, {column.type, column.has_width ? width : 0,
                                                       kChunkRows, options_.compression_level}));
    return Status();
  });
}

Status DatasetWriter::CheckSizes(const DatasetRows& rows) const {
  B4MRL_RETURN_IF_ERROR(VisitColumns(kColumns, [&](const auto& column, size_t) {
    return CheckSize(column.path, (rows.*column.values).size(), rows.rows, column.width(options_));
  }));
  if (rows.rows <= limits::kMaxDatasetRows - rows_) return Status();
  return Status(StatusCode::kLimitExceeded,
                fmt::format("a dataset holds at most {} rows", limits::kMaxDatasetRows));
}

Status DatasetWriter::Append(const DatasetRows& rows) {
  B4MRL_RETURN_IF_ERROR(CheckSizes(rows));
  // Append chunk by chunk, so that the order of chunks in the file does not depend on how the
  // caller split the rows.
  for (size_t first = 0; first < rows.rows;) {
    const size_t count = std::min<size_t>(rows.rows - first, kChunkRows - rows_ % kChunkRows);
    B4MRL_RETURN_IF_ERROR(VisitColumns(kColumns, [&](const auto& column, size_t number) -> Status {
      const size_t width = column.width(options_);
      if (width == 0) return Status();
      return file_.Append(ids_[number],
                          (rows.*column.values).subspan(first * width, count * width));
    }));
    rows_ += count;
    first += count;
  }
  return Status();
}

Status DatasetWriter::SetMetadata(std::string_view name, std::string_view text) {
  return file_.WriteString(fmt::format("metadata/{}", name), text);
}

Status DatasetWriter::SetMetadata(std::string_view name, int64_t value) {
  return file_.WriteInteger(fmt::format("metadata/{}", name), value);
}

Status DatasetWriter::SetProvenance(const DatasetProvenance& provenance) {
  return WriteDatasetProvenance(file_, provenance);
}

Status DatasetWriter::SetPolicy(const Agent& agent) { return WriteAgentInto(file_, agent); }

Status DatasetWriter::Commit(Existing existing) { return file_.Commit(existing); }

}  // namespace b4mrl
