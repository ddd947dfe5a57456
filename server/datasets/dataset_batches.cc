#include "server/datasets/dataset_batches.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "data/columns/gather.h"
#include "data/columns/sampler.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// That Read copies between two signs of life.
constexpr size_t kReadBytes = 256 * 1024;

// The five columns of a batch, in the order of the wire.
struct BatchColumn {
  const char* name;
  DType dtype;
  uint32_t width;  // 0: one-dimensional
  const void* source;

  size_t row_bytes() const { return DTypeSize(dtype) * std::max(width, 1u); }
};

std::array<BatchColumn, 5> BatchColumns(const TransitionColumns& columns) {
  const uint32_t size = columns.observation_size;
  return {{{"observations", DType::kFloat32, size, columns.observations.data()},
           {"actions", DType::kFloat32, columns.action_size, columns.actions.data()},
           {"rewards", DType::kFloat32, 0, columns.rewards.data()},
           {"next_observations", DType::kFloat32, size, columns.next_observations.data()},
           {"terminals", DType::kUint8, 0, columns.terminals.data()}}};
}

size_t AddArray(ArrayLayout& layout, const BatchColumn& column, uint64_t rows) {
  return column.width == 0 ? layout.Add(column.name, column.dtype, {rows})
                           : layout.Add(column.name, column.dtype, {rows, column.width});
}

Status CheckPayload(const ArrayLayout& layout) {
  if (layout.payload_bytes() <= limits::kMaxPayloadBytes) return Status();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("the reply would have {} bytes, allowed: {}; ask for fewer rows",
                            layout.payload_bytes(), limits::kMaxPayloadBytes));
}

}  // namespace

Result<Frame> AnswerFrom(const Dataset& dataset, const pb::SampleRequest& request,
                         const std::function<void()>& alive, pb::Reply* reply) {
  const uint32_t batches = std::max(request.batches(), 1u);
  if (batches > limits::kMaxBatchesPerSample) {
    return InvalidNumber("batches", batches, fmt::format("0..{}", limits::kMaxBatchesPerSample));
  }
  if (request.rows() == 0 || request.rows() > limits::kMaxRowsPerBatch) {
    return InvalidNumber("rows", request.rows(), fmt::format("1..{}", limits::kMaxRowsPerBatch));
  }
  const size_t rows = size_t{request.rows()} * batches;
  reply->mutable_sample();
  ArrayLayout layout(reply->mutable_arrays());
  const std::array<BatchColumn, 5> columns = BatchColumns(dataset.columns());
  std::array<size_t, 5> offsets{};
  for (size_t i = 0; i < columns.size(); ++i) offsets[i] = AddArray(layout, columns[i], rows);
  const size_t indices_offset =
      request.with_indices() ? layout.Add("indices", DType::kUint64, {rows}) : 0;
  B4MRL_RETURN_IF_ERROR(CheckPayload(layout));

  std::vector<uint64_t> indices(rows);
  for (uint32_t i = 0; i < batches; ++i) {
    SampleRows(request.seed(), request.first_batch() + i, dataset.rows(),
               std::span(indices).subspan(size_t{i} * request.rows(), request.rows()));
  }
  Frame payload = layout.Allocate();
  std::array<GatherColumn, 5> gather{};
  for (size_t i = 0; i < columns.size(); ++i) {
    gather[i] = {static_cast<const std::byte*>(columns[i].source), columns[i].row_bytes(),
                 payload.data() + offsets[i]};
  }
  GatherRows(gather, indices, alive);
  if (request.with_indices()) {
    std::ranges::copy(indices, ArrayAt<uint64_t>(payload, indices_offset, rows).begin());
  }
  return payload;
}

Result<Frame> AnswerFrom(const Dataset& dataset, const pb::ReadRequest& request,
                         const std::function<void()>& alive, pb::Reply* reply) {
  if (request.rows() == 0 || request.rows() > limits::kMaxRowsPerBatch) {
    return InvalidNumber("rows", request.rows(), fmt::format("1..{}", limits::kMaxRowsPerBatch));
  }
  if (request.first_row() > dataset.rows()) {
    return InvalidArgument("first_row", std::to_string(request.first_row()),
                           fmt::format("0..{}", dataset.rows()));
  }
  const uint64_t rows = std::min<uint64_t>(request.rows(), dataset.rows() - request.first_row());
  reply->mutable_read();
  ArrayLayout layout(reply->mutable_arrays());
  const std::array<BatchColumn, 5> five = BatchColumns(dataset.columns());
  std::vector<BatchColumn> columns(five.begin(), five.end());
  columns.push_back({"timeouts", DType::kUint8, 0, dataset.columns().timeouts.data()});
  std::vector<size_t> offsets;
  for (const BatchColumn& column : columns) offsets.push_back(AddArray(layout, column, rows));
  B4MRL_RETURN_IF_ERROR(CheckPayload(layout));
  Frame payload = layout.Allocate();
  for (size_t i = 0; i < columns.size(); ++i) {
    const size_t row_bytes = columns[i].row_bytes();
    const size_t bytes = rows * row_bytes;
    const std::byte* source =
        static_cast<const std::byte*>(columns[i].source) + request.first_row() * row_bytes;
    for (size_t done = 0; done < bytes; done += kReadBytes) {
      std::memcpy(payload.data() + offsets[i] + done, source + done,
                  std::min(kReadBytes, bytes - done));
      alive();
    }
  }
  return payload;
}

Result<Frame> AnswerFrom(const Dataset& dataset, const pb::DatasetStatsRequest&,
                         const std::function<void()>&, pb::Reply* reply) {
  const DatasetStatistics& statistics = dataset.statistics();
  pb::DatasetStatsReply* out = reply->mutable_dataset_stats();
  out->set_rows(dataset.rows());
  out->set_episodes(statistics.episodes);
  out->set_mean_return(statistics.mean_return);
  out->set_std_return(statistics.std_return);
  out->set_min_return(statistics.min_return);
  out->set_max_return(statistics.max_return);
  out->set_min_reward(statistics.min_reward);
  out->set_max_reward(statistics.max_reward);
  ArrayLayout layout(reply->mutable_arrays());
  const size_t size = statistics.observation_mean.size();
  const size_t mean = layout.Add("observation_mean", DType::kFloat64, {size});
  const size_t std = layout.Add("observation_std", DType::kFloat64, {size});
  Frame payload = layout.Allocate();
  std::ranges::copy(statistics.observation_mean, ArrayAt<double>(payload, mean, size).begin());
  std::ranges::copy(statistics.observation_std, ArrayAt<double>(payload, std, size).begin());
  return payload;
}

}  // namespace b4mrl
