// A request of a session that is being executed, from its validation to its reply.
//
// A factory (handlers.h) makes the job and Prepare validates it, on the socket's thread; threads of
// the executor execute its items; the thread that ends the last item completes the reply. Each item
// writes its results straight into the reply's payload, at a place of its own, so without a lock.
#pragma once

#include <google/protobuf/arena.h>

#include <array>
#include <atomic>
#include <mutex>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/ledger_counts.h"
#include "proto/wire/frame.h"
#include "proto/wire/socket.h"
#include "server/scheduling/work_queue.h"
#include "server/worker/session.h"

namespace b4mrl {

class PainterProcess;

// The private data of a thread that executes items.
struct WorkerThread {
  ThreadMark* mark = nullptr;         // null for the painter's thread
  PainterProcess* painter = nullptr;  // null for all but the painter's thread
  std::vector<double> observation;    // scratch
  std::vector<double> action;
};

// The input of a job's factory. The session outlives the job.
struct JobInput {
  Session* session = nullptr;
  const pb::Request* request = nullptr;  // valid until Prepare has returned
  Frame payload;                         // moved into the job, whose views point into it
};

class RequestJob : public QueuedWork {
 public:
  explicit RequestJob(JobInput& input);
  ~RequestJob() override = default;
  // Validates all that the request says, before anything is executed, and plans the reply. An error
  // is the reply; after OK the job can fail only for reasons of the simulator. A job without items
  // needs no execution, as all its lanes are answered from their slots; it only has to be
  // completed.
  virtual Status Prepare(const pb::Request& request) = 0;

  Session& owner() const { return *owner_; }
  pb::Request::PayloadCase kind() const { return kind_; }
  uint64_t request_id() const { return request_id_; }
  const Frame& payload() const { return payload_; }
  // Where the reply goes: to the sender of the request's latest copy. Socket's thread.
  RoutingId sender;
  Clock::time_point received;
  // What tells a copy of the request beside its kind and its arrays' bytes; 0 where these say all.
  size_t contents = 0;
  // Of the reply's arrays, as far as Prepare has made room for them.
  size_t planned_reply_bytes() const { return reply_payload_.size(); }
  size_t held_bytes = 0;  // by the request and its reply, while it is under way
  // The lanes that are busy with this job.
  const std::vector<uint32_t>& busy_lanes() const { return busy_lanes_; }

  struct PieceResult {
    uint32_t done;  // of the piece's first items, at least 1; the others are to be put back
    double us;      // that these took
  };
  // Executes a piece, or its beginning where it takes much longer than it was meant to.
  PieceResult RunPiece(const Piece& piece, WorkerThread& thread);
  // Counts `done` items as done. True: they were the job's last ones, and the calling thread
  // completes the job. False: another thread may complete and destroy the job at any moment.
  bool EndItems(uint32_t done);
  // Fills in the rest of the reply. To be called once, after all items.
  void Complete();
  // The finished reply. To be called once, after Complete.
  Result<Message> TakeReply();
  bool failed() const { return failed_.load(std::memory_order_relaxed); }

  // Whether the job's items wait for the painter's process instead of computing. A thread that does
  // nothing else executes these items, one after another.
  virtual bool waits_for_painter() const { return false; }
  // What the finished job adds to the counters of its worker and to its session's ledger.
  virtual LedgerCounts done() const { return {}; }

 private:
  // A reply and its table of arrays are a dozen small objects, which need no allocation each.
  alignas(8) std::array<char, 2048> arena_block_;
  google::protobuf::Arena arena_;

 protected:
  // Executes the items first, first + 1, ..., as long as a PieceTimer of `count` items lets them
  // begin, and returns how many: at least 1, and `count` after an error.
  virtual uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) = 0;
  // Called after all items if there was no error: adds the arrays whose shape depends on them.
  virtual void FinishReply() {}
  // The first error, as Refusal says it, becomes the reply. Any thread.
  void Fail(const Status& status);
  // `status` as a reply may say it: kInternal where is_partly_done_, since clients take most other
  // errors to say that nothing was executed.
  Status Refusal(const Status& status) const;

  pb::Reply& reply_;
  Frame reply_payload_;
  std::vector<uint32_t> busy_lanes_;
  // Whether some lanes are answered from their slots: a copy of the request, whose worker died, has
  // executed them.
  bool is_partly_done_ = false;

 private:
  Session* owner_;
  pb::Request::PayloadCase kind_;
  uint64_t request_id_;
  Frame payload_;
  std::atomic<uint32_t> items_done_{0};
  std::atomic<int64_t> started_us_{-1};  // microseconds from `received` to the first piece
  std::atomic<bool> failed_{false};
  std::mutex error_mutex_;
  Status error_;
};

}  // namespace b4mrl
