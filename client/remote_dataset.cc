#include "client/remote_dataset.h"

#include <algorithm>
#include <utility>

namespace b4mrl {
namespace {

// Batches share a reply only if they are so small that a reply's fixed cost matters.
constexpr uint64_t kMaxGroupBytes = 1 << 20;

// Bytes of a row in a reply: its numbers, two flags and an index. Each of the seven arrays may be
// padded.
constexpr uint64_t RowBytes(uint64_t observation_size, uint64_t action_size) {
  return (2 * observation_size + action_size + 1) * sizeof(float) + 2 + sizeof(uint64_t);
}
constexpr uint64_t kMaxPaddingBytes = 7 * limits::kArrayAlignment;

// Rows [first, first + count) of `all`.
TransitionRows SliceRows(const TransitionRows& all, size_t first, size_t count) {
  const auto slice = [&](const auto& column) {
    const size_t width = all.rows == 0 ? 0 : column.size() / all.rows;
    return column.subspan(first * width, count * width);
  };
  TransitionRows rows;
  rows.rows = count;
  rows.observations = slice(all.observations);
  rows.actions = slice(all.actions);
  rows.rewards = slice(all.rewards);
  rows.next_observations = slice(all.next_observations);
  rows.terminals = slice(all.terminals);
  rows.reply = all.reply;
  return rows;
}

}  // namespace

BatchStream::BatchStream(RemoteDataset* dataset, uint32_t rows, uint32_t credits, uint64_t seed,
                         uint64_t first_batch)
    : dataset_(dataset),
      rows_(rows),
      seed_(seed),
      next_batch_(first_batch),
      group_end_(first_batch) {
  credits = std::clamp(credits, 1u, limits::kMaxRequestsInFlight);
  const uint64_t values = 2 * dataset->observation_size() + dataset->action_size() + 1;
  const uint64_t batch_bytes = std::max<uint64_t>(rows, 1) * (values * sizeof(float) + 1);
  const uint64_t fitting = std::max<uint64_t>(kMaxGroupBytes / batch_bytes, 1);
  batches_per_request_ =
      static_cast<uint32_t>(std::min<uint64_t>(fitting, std::max(credits / 2, 1u)));
  max_requests_ = credits / batches_per_request_;
}

BatchStream::BatchStream(BatchStream&& other) noexcept
    : dataset_(other.dataset_),
      rows_(other.rows_),
      batches_per_request_(other.batches_per_request_),
      max_requests_(other.max_requests_),
      seed_(other.seed_),
      next_batch_(other.next_batch_),
      group_end_(other.group_end_),
      group_(std::move(other.group_)),
      requests_(std::exchange(other.requests_, {})) {}

BatchStream& BatchStream::operator=(BatchStream&& other) noexcept {
  if (this == &other) return *this;
  Abandon();
  dataset_ = other.dataset_;
  rows_ = other.rows_;
  batches_per_request_ = other.batches_per_request_;
  max_requests_ = other.max_requests_;
  seed_ = other.seed_;
  next_batch_ = other.next_batch_;
  group_end_ = other.group_end_;
  group_ = std::move(other.group_);
  requests_ = std::exchange(other.requests_, {});
  return *this;
}

BatchStream::~BatchStream() { Abandon(); }

void BatchStream::Abandon() {
  for (const uint64_t id : requests_) dataset_->connection_.Abandon(id);
  requests_.clear();
}

Status BatchStream::TopUp() {
  while (requests_.size() < max_requests_) {
    const uint64_t first = group_end_ + requests_.size() * batches_per_request_;
    B4MRL_ASSIGN_OR_RETURN(const uint64_t id,
                           dataset_->SendSample(rows_, seed_, first, batches_per_request_, false));
    requests_.push_back(id);
  }
  return Status();
}

Status BatchStream::ReceiveGroup() {
  if (requests_.empty()) B4MRL_RETURN_IF_ERROR(TopUp());
  const uint64_t id = requests_.front();
  requests_.pop_front();
  Result<TransitionRows> group =
      dataset_->ReadRows(dataset_->connection_.Receive(id), uint64_t{rows_} * batches_per_request_);
  if (!group.ok()) {
    dataset_->connection_.Abandon(id);
    Abandon();
    return group.status();
  }
  group->first_batch = group_end_;
  group_ = std::move(*group);
  group_end_ += batches_per_request_;
  return Status();
}

Result<TransitionRows> BatchStream::Next() {
  if (next_batch_ == group_end_) B4MRL_RETURN_IF_ERROR(ReceiveGroup());
  TransitionRows batch = SliceRows(group_, (next_batch_ - group_.first_batch) * rows_, rows_);
  batch.first_batch = next_batch_++;
  // If a request cannot be sent now, a later call sends it, or reports the error.
  if (next_batch_ == group_end_) (void)TopUp();
  return batch;
}

BatchStream RemoteDataset::Stream(uint32_t rows, uint64_t seed, uint64_t first_batch,
                                  uint32_t credits) {
  return BatchStream(this, rows, credits, seed, first_batch);
}

uint32_t RemoteDataset::MaxRowsPerRequest(size_t observation_size, size_t action_size) {
  const uint64_t fitting =
      (limits::kMaxPayloadBytes - kMaxPaddingBytes) / RowBytes(observation_size, action_size);
  return static_cast<uint32_t>(std::min<uint64_t>(fitting, limits::kMaxRowsPerBatch));
}

Result<DatasetStats> RemoteDataset::Stats() {
  pb::Request request;
  request.mutable_dataset_stats()->set_fingerprint(fingerprint());
  B4MRL_ASSIGN_OR_RETURN(ReceivedReply reply,
                         connection_.Call(std::move(request), Frame(), NewDeadline()));
  DatasetStats stats;
  for (const auto& [name, out] : {std::pair{"observation_mean", &stats.observation_mean},
                                  std::pair{"observation_std", &stats.observation_std}}) {
    B4MRL_ASSIGN_OR_RETURN(const auto values, reply.Column<double>(name, {observation_size()}));
    out->assign(values.begin(), values.end());
  }
  stats.scores = std::move(*reply.envelope.mutable_dataset_stats());
  return stats;
}

Result<uint64_t> RemoteDataset::SendSample(uint32_t rows, uint64_t seed, uint64_t first_batch,
                                           uint32_t batches, bool with_indices) {
  pb::Request request;
  pb::SampleRequest* sample = request.mutable_sample();
  sample->set_fingerprint(fingerprint());
  sample->set_seed(seed);
  sample->set_first_batch(first_batch);
  sample->set_batches(batches);
  sample->set_rows(rows);
  sample->set_with_indices(with_indices);
  sample->set_ledger(ledger_);
  return connection_.Send(std::move(request), Frame(), NewDeadline());
}

Result<TransitionRows> RemoteDataset::Sample(uint32_t rows, uint64_t seed, uint64_t first_batch,
                                             uint32_t batches, bool with_indices) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id,
                         SendSample(rows, seed, first_batch, batches, with_indices));
  B4MRL_ASSIGN_OR_RETURN(TransitionRows out,
                         ReadRows(connection_.Receive(id), uint64_t{rows} * std::max(batches, 1u)));
  out.first_batch = first_batch;
  return out;
}

Result<TransitionRows> RemoteDataset::Read(uint64_t first_row, uint32_t rows) {
  pb::Request request;
  pb::ReadRequest* read = request.mutable_read();
  read->set_fingerprint(fingerprint());
  read->set_first_row(first_row);
  read->set_rows(rows);
  read->set_ledger(ledger_);
  // The server refuses rows beyond the last one, with a better message than could be made here.
  const uint64_t left = this->rows() - std::min(first_row, this->rows());
  return ReadRows(connection_.Call(std::move(request), Frame(), NewDeadline()),
                  std::min<uint64_t>(rows, left));
}

Result<TransitionRows> RemoteDataset::ReadRows(Result<ReceivedReply> reply, uint64_t rows) const {
  if (!reply.ok()) return reply.status();
  TransitionRows out;
  out.reply = std::make_shared<const ReceivedReply>(std::move(*reply));
  out.rows = rows;
  const ReceivedReply& columns = *out.reply;
  B4MRL_ASSIGN_OR_RETURN(out.observations,
                         columns.Column<float>("observations", {rows, observation_size()}));
  B4MRL_ASSIGN_OR_RETURN(out.actions, columns.Column<float>("actions", {rows, action_size()}));
  B4MRL_ASSIGN_OR_RETURN(out.rewards, columns.Column<float>("rewards", {rows}));
  B4MRL_ASSIGN_OR_RETURN(out.next_observations,
                         columns.Column<float>("next_observations", {rows, observation_size()}));
  B4MRL_ASSIGN_OR_RETURN(out.terminals, columns.Column<uint8_t>("terminals", {rows}));
  if (columns.arrays.Has("timeouts")) {
    B4MRL_ASSIGN_OR_RETURN(out.timeouts, columns.Column<uint8_t>("timeouts", {rows}));
  }
  if (columns.arrays.Has("indices")) {
    B4MRL_ASSIGN_OR_RETURN(out.indices, columns.Column<uint64_t>("indices", {rows}));
  }
  return out;
}

}  // namespace b4mrl
