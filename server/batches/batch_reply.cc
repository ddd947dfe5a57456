#include "server/batches/batch_reply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>

#include "data/columns/gather.h"
#include "data/columns/sampler.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr size_t kPageBytes = 4096;  // of a file; the unit in which a Read is copied
constexpr size_t kRowsDrawn = 8192;  // of a Sample, at once, if its batches are shorter
// A Sample has all columns but the last one, the timeouts.
constexpr size_t kAllColumns = std::tuple_size_v<decltype(kTransitionColumns)>;
constexpr size_t kSampledColumns = kAllColumns - 1;

}  // namespace

Result<BatchReply> BatchReply::To(const pb::SampleRequest& request,
                                  std::shared_ptr<const Dataset> dataset) {
  const uint32_t batches = std::max(request.batches(), 1u);
  if (batches > limits::kMaxBatchesPerSample) {
    return InvalidNumber("batches", batches, fmt::format("0..{}", limits::kMaxBatchesPerSample));
  }
  if (request.rows() == 0 || request.rows() > limits::kMaxRowsPerBatch) {
    return InvalidNumber("rows", request.rows(), fmt::format("1..{}", limits::kMaxRowsPerBatch));
  }
  BatchReply reply(std::move(dataset), uint64_t{request.rows()} * batches);
  reply.envelope.mutable_sample();
  ArrayLayout layout(reply.envelope.mutable_arrays());
  reply.AddArrays(kSampledColumns, &layout);
  reply.draw_ = {request.seed(), request.first_batch(), request.rows(), batches, std::nullopt};
  if (request.with_indices()) {
    reply.draw_->indices_offset = layout.Add("indices", DType::kUint64, {reply.rows_});
  }
  B4MRL_RETURN_IF_ERROR(reply.SetPayload(layout));
  return reply;
}

Result<BatchReply> BatchReply::To(const pb::ReadRequest& request,
                                  std::shared_ptr<const Dataset> dataset) {
  if (request.rows() == 0 || request.rows() > limits::kMaxRowsPerBatch) {
    return InvalidNumber("rows", request.rows(), fmt::format("1..{}", limits::kMaxRowsPerBatch));
  }
  const uint64_t first = request.first_row(), all = dataset->rows();
  if (first > all) {
    return InvalidArgument("first_row", std::to_string(first), fmt::format("0..{}", all));
  }
  BatchReply reply(std::move(dataset), std::min<uint64_t>(request.rows(), all - first));
  reply.envelope.mutable_read();
  ArrayLayout layout(reply.envelope.mutable_arrays());
  reply.AddArrays(kAllColumns, &layout);
  for (Column& column : reply.columns_) column.source += first * column.row_bytes;
  B4MRL_RETURN_IF_ERROR(reply.SetPayload(layout));
  return reply;
}

Result<BatchReply> BatchReply::To(const pb::DatasetStatsRequest&,
                                  std::shared_ptr<const Dataset> dataset) {
  BatchReply reply(std::move(dataset), 1);
  const DatasetStatistics& statistics = reply.dataset_->statistics();
  pb::DatasetStatsReply* out = reply.envelope.mutable_dataset_stats();
  out->set_rows(reply.dataset_->rows());
  out->set_episodes(statistics.episodes);
  out->set_mean_return(statistics.mean_return);
  out->set_std_return(statistics.std_return);
  out->set_min_return(statistics.min_return);
  out->set_max_return(statistics.max_return);
  out->set_min_reward(statistics.min_reward);
  out->set_max_reward(statistics.max_reward);
  ArrayLayout layout(reply.envelope.mutable_arrays());
  for (const auto& [name, values] : {std::pair{"observation_mean", &statistics.observation_mean},
                                     std::pair{"observation_std", &statistics.observation_std}}) {
    const size_t offset = layout.Add(name, DType::kFloat64, {values->size()});
    reply.columns_.push_back(
        {std::as_bytes(std::span(*values)).data(), values->size() * sizeof(double), offset});
  }
  B4MRL_RETURN_IF_ERROR(reply.SetPayload(layout));
  return reply;
}

void BatchReply::AddArrays(size_t count, ArrayLayout* layout) {
  const TransitionColumns& all = dataset_->columns();
  static_cast<void>(VisitColumns(kTransitionColumns, [&](const auto& column, size_t number) {
    if (number >= count) return Status();
    using T = typename std::decay_t<decltype(column)>::Value;
    const uint64_t width = column.width(all);
    const size_t offset = column.size ? layout->Add(column.name, DTypeOf<T>(), {rows_, width})
                                      : layout->Add(column.name, DTypeOf<T>(), {rows_});
    columns_.push_back({std::as_bytes(all.*column.values).data(), width * sizeof(T), offset});
    return Status();
  }));
}

Status BatchReply::SetPayload(const ArrayLayout& layout) {
  payload_bytes_ = layout.payload_bytes();
  if (payload_bytes_ <= limits::kMaxPayloadBytes) return Status();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("the reply would have {} bytes, allowed: {}; ask for fewer rows",
                            payload_bytes_, limits::kMaxPayloadBytes));
}

bool BatchReply::Fill(const std::function<size_t()>& pace) {
  if (payload.size() < payload_bytes_) {
    payload = ArrayLayout(envelope.mutable_arrays(), payload_bytes_).Allocate();
  }
  return draw_ ? CopyRows(pace) : CopyColumns(pace);
}

bool BatchReply::CopyColumns(const std::function<size_t()>& pace) {
  for (size_t pages = 1; column_ < columns_.size(); ++column_, bytes_copied_ = 0) {
    const Column& column = columns_[column_];
    for (const size_t bytes = rows_ * column.row_bytes; bytes_copied_ < bytes;) {
      const size_t piece = std::min(pages * kPageBytes, bytes - bytes_copied_);
      std::memcpy(payload.data() + column.offset + bytes_copied_, column.source + bytes_copied_,
                  piece);
      bytes_copied_ += piece;
      pages = pace();
      if (pages == 0) return false;
    }
  }
  return true;
}

bool BatchReply::CopyRows(const std::function<size_t()>& pace) {
  while (rows_copied_ < rows_) {
    if (draw_->copied == draw_->drawn.size()) DrawBatches();
    std::vector<GatherColumn> columns;
    for (const Column& column : columns_) {
      columns.push_back({column.source, column.row_bytes,
                         payload.data() + column.offset + rows_copied_ * column.row_bytes});
    }
    const size_t copied = GatherRows(columns, std::span(draw_->drawn).subspan(draw_->copied), pace);
    draw_->copied += copied;
    rows_copied_ += copied;
    if (draw_->copied < draw_->drawn.size()) return false;
  }
  return true;
}

// Draws the next batches, whose rows take the place of those that were copied.
void BatchReply::DrawBatches() {
  const uint32_t wanted = std::max<uint32_t>(kRowsDrawn / draw_->rows_of_batch, 1);
  const uint32_t batches = std::min(wanted, draw_->batches - draw_->batches_drawn);
  draw_->drawn.resize(size_t{batches} * draw_->rows_of_batch);
  draw_->copied = 0;
  for (uint32_t i = 0; i < batches; ++i) {
    SampleRows(
        draw_->seed, draw_->first_batch + draw_->batches_drawn++, dataset_->rows(),
        std::span(draw_->drawn).subspan(size_t{i} * draw_->rows_of_batch, draw_->rows_of_batch));
  }
  if (!draw_->indices_offset) return;
  std::ranges::copy(draw_->drawn,
                    ArrayAt<uint64_t>(payload, *draw_->indices_offset, rows_).begin() +
                        static_cast<ptrdiff_t>(rows_copied_));
}

}  // namespace b4mrl
