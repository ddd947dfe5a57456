// The replies to Sample, Read and DatasetStats. Rows are gathered straight into the frame that is
// sent, row by row or page by page: those that have to come from the disk can take long, and others
// are to be answered in between. Errors: kInvalidArgument with the argument's name. Thread rule:
// one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "data/columns/dataset.h"
#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

class BatchReply {
 public:
  // The reply's payload case and its table of arrays. The reply keeps the dataset mapped.
  static Result<BatchReply> To(const pb::SampleRequest& request,
                               std::shared_ptr<const Dataset> dataset);
  static Result<BatchReply> To(const pb::ReadRequest& request,
                               std::shared_ptr<const Dataset> dataset);
  static Result<BatchReply> To(const pb::DatasetStatsRequest& request,
                               std::shared_ptr<const Dataset> dataset);

  // Copies rows, some in any case, until all are copied or `pace` returns 0. It is called after the
  // first row, and then after as many rows as it returned (at most 1000); of a Read, after as many
  // pages of 4096 bytes. Returns whether all are copied.
  bool Fill(const std::function<size_t()>& pace);

  size_t payload_bytes() const { return payload_bytes_; }
  pb::Reply envelope;
  Frame payload;  // empty before the first Fill

 private:
  // A column of the dataset from the first row on, and where its array begins in the payload.
  struct Column {
    const std::byte* source;
    size_t row_bytes;
    size_t offset;
  };
  // What a Sample draws.
  struct Draw {
    uint64_t seed, first_batch;
    uint32_t rows_of_batch, batches;
    std::optional<size_t> indices_offset;  // of the array of drawn rows, where it is wanted
    uint32_t batches_drawn = 0;
    std::vector<uint64_t> drawn = {};  // rows of the newest batches that were drawn
    size_t copied = 0;                 // of these
  };

  // A reply with arrays of `rows` rows.
  BatchReply(std::shared_ptr<const Dataset> dataset, uint64_t rows)
      : dataset_(std::move(dataset)), rows_(rows) {}

  // Adds arrays of rows_ rows for the first `count` columns.
  void AddArrays(size_t count, ArrayLayout* layout);
  Status SetPayload(const ArrayLayout& layout);
  bool CopyColumns(const std::function<size_t()>& pace);
  bool CopyRows(const std::function<size_t()>& pace);
  void DrawBatches();

  std::shared_ptr<const Dataset> dataset_;
  uint64_t rows_;
  size_t payload_bytes_ = 0;
  std::vector<Column> columns_;
  // Of a Sample, which copies row after row:
  std::optional<Draw> draw_;
  uint64_t rows_copied_ = 0;
  // Of the others, which copy column after column:
  size_t column_ = 0;        // the columns before this one are copied,
  size_t bytes_copied_ = 0;  // and so many bytes of it
};

}  // namespace b4mrl
