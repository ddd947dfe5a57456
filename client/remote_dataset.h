// A dataset of the daemon, possibly corrupted: its statistics, random batches, rows in order.
//
// Requests name the dataset by its fingerprint, so a restarted dataset worker can serve them. The
// rows of batch b are a function of (seed, b, rows of a batch) alone: every client gets the same
// rows, however often it asks. Thread rule: one thread. The Client that opened the dataset may end
// before it.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/connection.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetOptions {
  std::vector<NamedArgument> corruption;   // in the order in which they apply, but `hidden` last
  uint64_t seed = 0;                       // of the corruptions' noise
  std::string transition_rule = "stored";  // "stored" or "d4rl" (data/columns/episodes.h)
  std::string environment;                 // refuse data of another environment; "" takes any
  int64_t open_deadline_ms = 300'000;      // of the opening, which may import the file first
  int64_t deadline_ms = limits::kDefaultDeadlineMs;  // of each later request
  uint64_t ledger = 0;  // counts the rows served, also those requested ahead; 0: none
                        // (Client::OpenLedger)
};

// Rows of a dataset, row-major, as views into the received frame, or into an aligned copy of it for
// messages of a few KiB. `reply` keeps that memory alive.
struct TransitionRows {
  size_t rows = 0;
  std::span<const float> observations;       // rows x observation size
  std::span<const float> actions;            // rows x action size
  std::span<const float> rewards;            // rows
  std::span<const float> next_observations;  // rows x observation size
  std::span<const uint8_t> terminals;        // rows
  std::span<const uint8_t> timeouts;         // rows, after Read alone
  std::span<const uint64_t> indices;         // rows, after Sample with `with_indices` alone
  uint64_t first_batch = 0;                  // number of the first batch, after Sample and Next
  std::shared_ptr<const ReceivedReply> reply;
};

struct DatasetStats {
  // Mean and population standard deviation of served observations, corruptions included.
  std::vector<double> observation_mean;
  std::vector<double> observation_std;
  pb::DatasetStatsReply scores;
};

class RemoteDataset;

// Random batches with the numbers first_batch, first_batch + 1, ... Up to `credits` batches are
// requested ahead, so that the next one has usually arrived when it is needed. A reply holds
// several batches if they are small; one call of Next then receives the reply, another one sends
// new requests, and both are short. After an error, Next requests the same batch again. The dataset
// must outlive its streams and must not be moved while it has some; they share its limit of
// limits::kMaxRequestsInFlight.
class BatchStream {
 public:
  BatchStream(BatchStream&& other) noexcept;
  BatchStream& operator=(BatchStream&& other) noexcept;
  ~BatchStream();

  Result<TransitionRows> Next();
  // The number of the batch that Next returns next. A new stream whose first_batch is this number
  // continues this stream.
  uint64_t next_batch() const { return next_batch_; }

 private:
  friend class RemoteDataset;
  BatchStream(RemoteDataset* dataset, uint32_t rows, uint32_t credits, uint64_t seed,
              uint64_t first_batch);
  Status TopUp();
  // Receives the next reply into group_.
  Status ReceiveGroup();
  void Abandon();

  RemoteDataset* dataset_;
  uint32_t rows_;
  uint32_t batches_per_request_;
  uint32_t max_requests_;
  uint64_t seed_;
  uint64_t next_batch_;            // number of the batch that Next returns next
  uint64_t group_end_;             // number after the last batch in group_
  TransitionRows group_;           // batches of the last reply, from group_.first_batch on
  std::deque<uint64_t> requests_;  // requests in flight, for the batches from group_end_ on
};

class RemoteDataset {
 public:
  const pb::OpenDatasetReply& in_force() const { return in_force_; }
  const std::string& fingerprint() const { return in_force_.fingerprint(); }
  // The environment in which the dataset was recorded; "" if the server does not know it.
  const std::string& environment() const { return in_force_.environment(); }
  uint64_t rows() const { return in_force_.rows(); }
  size_t observation_size() const { return in_force_.observation_size(); }
  size_t action_size() const { return in_force_.action_size(); }
  // The most rows of one Sample or Read: limits::kMaxRowsPerBatch, or as many as fit a payload.
  static uint32_t MaxRowsPerRequest(size_t observation_size, size_t action_size);
  uint32_t max_rows_per_request() const {
    return MaxRowsPerRequest(observation_size(), action_size());
  }

  Result<DatasetStats> Stats();
  // `batches` random batches of `rows` rows each, one after another.
  Result<TransitionRows> Sample(uint32_t rows, uint64_t seed, uint64_t first_batch,
                                uint32_t batches = 1, bool with_indices = false);
  // Rows [first_row, first_row + rows) in the file's order; fewer at the dataset's end.
  Result<TransitionRows> Read(uint64_t first_row, uint32_t rows);
  // `credits` (at least 1) batches are requested ahead.
  BatchStream Stream(uint32_t rows, uint64_t seed, uint64_t first_batch = 0, uint32_t credits = 4);

 private:
  friend class Client;
  friend class BatchStream;
  RemoteDataset(Connection connection, pb::OpenDatasetReply in_force, int64_t deadline_ms,
                uint64_t ledger)
      : connection_(std::move(connection)),
        in_force_(std::move(in_force)),
        deadline_ms_(deadline_ms),
        ledger_(ledger) {}
  Result<uint64_t> SendSample(uint32_t rows, uint64_t seed, uint64_t first_batch, uint32_t batches,
                              bool with_indices);
  // kInternal for a reply with another number of rows: callers have room for `rows` rows.
  Result<TransitionRows> ReadRows(Result<ReceivedReply> reply, uint64_t rows) const;
  Deadline NewDeadline() const { return Deadline::AfterMs(deadline_ms_); }

  Connection connection_;
  pb::OpenDatasetReply in_force_;
  int64_t deadline_ms_;
  uint64_t ledger_;
};

}  // namespace b4mrl
