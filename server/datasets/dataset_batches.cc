#include "server/datasets/dataset_batches.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "data/columns/gather.h"
#include "data/columns/sampler.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// Bytes that Read copies between two calls of `alive`.
constexpr size_t kReadBytes = 256 * 1024;
// A Sample has all columns but the last one, the timeouts.
constexpr size_t kAllColumns = std::tuple_size_v<decltype(kTransitionColumns)>;
constexpr size_t kSampledColumns = kAllColumns - 1;

// A column of a reply, and where its array begins in the payload.
struct BatchColumn {
  const std::byte* source;
  size_t row_bytes;
  size_t offset;
};

// Lays out arrays of `rows` rows for the first `count` columns of a dataset.
std::vector<BatchColumn> AddArrays(const TransitionColumns& columns, size_t count, uint64_t rows,
                                   ArrayLayout* layout) {
  std::vector<BatchColumn> added;
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t number) {
    if (number >= count) return Status();
    using T = typename std::decay_t<decltype(column)>::Value;
    const uint64_t width = column.width(columns);
    const size_t offset = column.size ? layout->Add(column.name, DTypeOf<T>(), {rows, width})
                                      : layout->Add(column.name, DTypeOf<T>(), {rows});
    added.push_back({std::as_bytes(columns.*column.values).data(), width * sizeof(T), offset});
    return Status();
  }));
  return added;
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
  const std::vector<BatchColumn> columns =
      AddArrays(dataset.columns(), kSampledColumns, rows, &layout);
  const size_t indices_offset =
      request.with_indices() ? layout.Add("indices", DType::kUint64, {rows}) : 0;
  B4MRL_RETURN_IF_ERROR(CheckPayload(layout));

  std::vector<uint64_t> indices(rows);
  for (uint32_t i = 0; i < batches; ++i) {
    SampleRows(request.seed(), request.first_batch() + i, dataset.rows(),
               std::span(indices).subspan(size_t{i} * request.rows(), request.rows()));
  }
  Frame payload = layout.Allocate();
  std::vector<GatherColumn> gather;
  for (const BatchColumn& column : columns) {
    gather.push_back({column.source, column.row_bytes, payload.data() + column.offset});
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
  const std::vector<BatchColumn> columns = AddArrays(dataset.columns(), kAllColumns, rows, &layout);
  B4MRL_RETURN_IF_ERROR(CheckPayload(layout));
  Frame payload = layout.Allocate();
  for (const BatchColumn& column : columns) {
    const size_t bytes = rows * column.row_bytes;
    const std::byte* source = column.source + request.first_row() * column.row_bytes;
    for (size_t done = 0; done < bytes; done += kReadBytes) {
      std::memcpy(payload.data() + column.offset + done, source + done,
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
