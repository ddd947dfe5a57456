#include "server/worker/request_job.h"

#include "proto/base/limits.h"

namespace b4mrl {

RequestJob::RequestJob(JobInput& input)
    : arena_(arena_block_.data(), arena_block_.size()),
      reply_(*google::protobuf::Arena::CreateMessage<pb::Reply>(&arena_)),
      owner_(input.session),
      kind_(input.request->payload_case()),
      request_id_(input.request->request_id()),
      payload_(std::move(input.payload)) {
  session = owner_->index();
  cost = &owner_->cost(kind_);
}

RequestJob::PieceResult RequestJob::RunPiece(const Piece& piece, WorkerThread& thread) {
  const Clock::time_point start = Clock::now();
  int64_t unset = -1;
  started_us_.compare_exchange_strong(unset, MicrosecondsBetween(received, start));
  if (piece.expired) {
    Fail(Status(StatusCode::kDeadlineExceeded,
                piece.count == items && !is_partly_done_
                    ? "the deadline passed before anything was executed"
                    : "the deadline passed before all of it was executed"));
    return {piece.count, 0};
  }
  const uint32_t done = RunItems(piece.first, piece.count, thread);
  return {done, 1e6 * SecondsSince(start)};
}

bool RequestJob::EndItems(uint32_t done) {
  // Read first: once these items count as done, another thread may complete and destroy the job.
  const uint32_t all_items = items;
  return items_done_.fetch_add(done, std::memory_order_acq_rel) + done == all_items;
}

Status RequestJob::Refusal(const Status& status) const {
  if (!is_partly_done_) return status;
  return Status(StatusCode::kInternal,
                status.message() + "; earlier, other lanes of the request were executed");
}

void RequestJob::Fail(const Status& status) {
  std::lock_guard lock(error_mutex_);
  if (error_.ok()) error_ = Refusal(status);
  failed_.store(true, std::memory_order_release);
}

void RequestJob::Complete() {
  const Clock::time_point simulated = Clock::now();
  reply_.set_protocol_version(limits::kProtocolVersion);
  reply_.set_request_id(request_id_);
  if (!failed()) FinishReply();
  if (failed()) {
    reply_.clear_arrays();
    reply_.clear_payload();
    reply_payload_ = Frame();
    std::lock_guard lock(error_mutex_);
    SetStatus(error_, reply_.mutable_status());
  }
  const int64_t queued_us = std::max<int64_t>(0, started_us_.load(std::memory_order_relaxed));
  pb::Timing* timing = reply_.mutable_timing();
  timing->set_queued_us(static_cast<uint32_t>(queued_us));
  timing->set_simulating_us(
      static_cast<uint32_t>(MicrosecondsBetween(received, simulated) - queued_us));
  timing->set_serialising_us(static_cast<uint32_t>(MicrosecondsBetween(simulated, Clock::now())));
}

Result<Message> RequestJob::TakeReply() {
  B4MRL_ASSIGN_OR_RETURN(Frame envelope, SerializeEnvelope(reply_));
  return Message{std::move(envelope), std::move(reply_payload_)};
}

}  // namespace b4mrl
