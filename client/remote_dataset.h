// A dataset, possibly corrupted, as the daemon serves it: statistics, random batches, rows in
// order.
//
// Requests name the dataset by its fingerprint, so a restarted dataset worker serves them like the
// old one. Batch b holds the same rows whoever asks and however often: they are a function of
// (seed, b, rows). Thread rule: one thread. The Client that made it outlives it.
#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <vector>

#include "client/connection.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

struct DatasetOptions {
  std::vector<NamedArgument> corruption;
  uint64_t seed = 0;                       // of the corruption's noise
  std::string transition_rule = "stored";  // or "d4rl"
  // Opening may import a file first; further requests take the usual deadline.
  int64_t open_deadline_ms = 300'000;
  int64_t deadline_ms = limits::kDefaultDeadlineMs;
};

// Rows of a dataset, row-major, as views into the received frame, which the batch owns (or into an
// aligned copy of it, for messages of a few KiB).
struct TransitionRows {
  size_t rows = 0;
  std::span<const float> observations;       // rows x observation size
  std::span<const float> actions;            // rows x action size
  std::span<const float> rewards;            // rows
  std::span<const float> next_observations;  // rows x observation size
  std::span<const uint8_t> terminals;        // rows
  std::span<const uint8_t> timeouts;         // rows, of Read alone
  std::span<const uint64_t> indices;         // rows, if asked for
  uint64_t first_batch = 0;                  // of Sample and streams
  ReceivedReply reply;
};

struct DatasetStats {
  std::vector<double> observation_mean;  // of the served (corrupted) observations
  std::vector<double> observation_std;   // population
  pb::DatasetStatsReply scores;
};

class RemoteDataset;

// Batches first_batch, first_batch + 1, ...: `credits` requests are kept in flight, so that the
// next batch is usually here before it is asked for. After an error, Next asks for the same batch
// again. The dataset stays where it is while streams of it live; they share its limit of
// limits::kMaxRequestsInFlight.
class BatchStream {
 public:
  BatchStream(BatchStream&& other) noexcept;
  BatchStream& operator=(BatchStream&& other) noexcept;
  ~BatchStream();

  Result<TransitionRows> Next();
  // The batch that Next returns; a stream made with it as first_batch continues this one.
  uint64_t next_batch() const { return next_batch_; }

 private:
  friend class RemoteDataset;
  BatchStream(RemoteDataset* dataset, uint32_t rows, uint32_t credits, uint64_t seed,
              uint64_t first_batch)
      : dataset_(dataset), rows_(rows), credits_(credits), seed_(seed), next_batch_(first_batch) {}
  Status TopUp();
  void Abandon();

  RemoteDataset* dataset_;
  uint32_t rows_;
  uint32_t credits_;
  uint64_t seed_;
  uint64_t next_batch_;
  std::deque<uint64_t> requests_;  // for next_batch_, next_batch_ + 1, ...
};

class RemoteDataset {
 public:
  const pb::OpenDatasetReply& in_force() const { return in_force_; }
  const std::string& fingerprint() const { return in_force_.fingerprint(); }
  uint64_t rows() const { return in_force_.rows(); }
  size_t observation_size() const { return in_force_.observation_size(); }
  size_t action_size() const { return in_force_.action_size(); }

  Result<DatasetStats> Stats();
  // `batches` batches of `rows` rows after one another.
  Result<TransitionRows> Sample(uint32_t rows, uint64_t seed, uint64_t first_batch,
                                uint32_t batches = 1, bool with_indices = false);
  // Rows [first_row, first_row + rows), fewer at the end.
  Result<TransitionRows> Read(uint64_t first_row, uint32_t rows);
  // `credits` (at least 1) batches are requested ahead.
  BatchStream Stream(uint32_t rows, uint64_t seed, uint64_t first_batch = 0, uint32_t credits = 4);

 private:
  friend class Client;
  friend class BatchStream;
  RemoteDataset(Connection connection, pb::OpenDatasetReply in_force, int64_t deadline_ms)
      : connection_(std::move(connection)),
        in_force_(std::move(in_force)),
        deadline_ms_(deadline_ms) {}
  Result<uint64_t> SendSample(uint32_t rows, uint64_t seed, uint64_t first_batch, uint32_t batches,
                              bool with_indices);
  Result<TransitionRows> ReadRows(Result<ReceivedReply> reply, uint64_t first_batch) const;
  Deadline NewDeadline() const { return Deadline::AfterMs(deadline_ms_); }

  Connection connection_;
  pb::OpenDatasetReply in_force_;
  int64_t deadline_ms_;
};

}  // namespace b4mrl
