// A request of a session that is being executed, from its validation to its reply.
//
// A handler (handlers.h) builds it on the socket's thread, fully validated; threads of the pool
// execute its items; whichever ends the last one completes the reply. Items write their results
// straight into the reply's payload, at places of their own, so they need no lock.
#pragma once

#include <google/protobuf/arena.h>

#include <array>
#include <atomic>
#include <mutex>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/wire/frame.h"
#include "proto/wire/socket.h"
#include "server/scheduling/work_queue.h"
#include "server/worker/session.h"

namespace b4mrl {

class PainterProcess;

// What a thread that executes items has for itself.
struct WorkerThread {
  ThreadMark* mark = nullptr;         // none of the painter thread
  PainterProcess* painter = nullptr;  // of the painter thread alone
  std::vector<double> observation;    // scratch
  std::vector<double> action;
};

class RequestJob : public QueuedWork {
 public:
  // `owner` outlives the job. `frame` is the request's payload, kept for as long as views into it
  // live.
  RequestJob(Session* owner, pb::Request::PayloadCase kind, uint64_t request_id, Frame frame);
  ~RequestJob() override = default;

  Session& owner() const { return *owner_; }
  pb::Request::PayloadCase kind() const { return kind_; }
  uint64_t request_id() const { return request_id_; }
  const Frame& payload() const { return payload_; }
  // Where the reply goes; a resent request moves it (socket's thread).
  RoutingId sender;
  Clock::time_point received;
  // The lanes that are busy with this job.
  const std::vector<uint32_t>& busy_lanes() const { return busy_lanes_; }

  // Executes a piece; the microseconds that it took.
  double RunPiece(const Piece& piece, WorkerThread& thread);
  // The piece counts as done. True for the thread that ended the job's last one, which then calls
  // Complete; for all others the job may be gone.
  bool EndPiece(const Piece& piece);
  // Fills in the rest of the reply. Once, after all items.
  void Complete();
  // The finished reply; once, after Complete.
  Result<Message> TakeReply();
  bool failed() const { return failed_.load(std::memory_order_relaxed); }

  // Whether its items wait for another process instead of computing. They are executed by a thread
  // that does nothing else, one at a time.
  virtual bool waits_for_painter() const { return false; }
  // What the job adds to its worker's counters.
  virtual uint64_t steps_done() const { return 0; }
  virtual uint64_t rows_done() const { return 0; }

 private:
  // A reply and its table of arrays are a dozen small objects, which need no allocation each.
  alignas(8) std::array<char, 2048> arena_block_;
  google::protobuf::Arena arena_;

 protected:
  virtual void RunItems(uint32_t first, uint32_t count, WorkerThread& thread) = 0;
  // After all items and no error: arrays that could not be planned beforehand.
  virtual void FinishReply() {}
  // The first error becomes the reply. Any thread.
  void Fail(Status status);

  pb::Reply& reply_;
  Frame reply_payload_;
  std::vector<uint32_t> busy_lanes_;

 private:
  Session* owner_;
  pb::Request::PayloadCase kind_;
  uint64_t request_id_;
  Frame payload_;
  std::atomic<uint32_t> items_done_{0};
  std::atomic<int64_t> started_us_{-1};  // after `received`
  std::atomic<bool> failed_{false};
  std::mutex error_mutex_;
  Status error_;
};

}  // namespace b4mrl
