// Handles the messages of an environment worker: finds a request's session, applies the limits and
// the rules of exactly once, has the work executed, and answers every request exactly once.
//
// Thread rule: the socket's thread. Replies leave through a function, so that tests need no socket.
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <unordered_map>

#include "proto/b4mrl.pb.h"
#include "proto/wire/socket.h"
#include "server/process/memory_shares.h"
#include "server/replies/reply.h"
#include "server/shared_memory/ledger_table.h"
#include "server/shared_memory/shared_state.h"
#include "server/worker/executor.h"
#include "server/worker/session.h"

namespace b4mrl {

class Dispatcher {
 public:
  // `worker` is this worker's index. `memory`: what simulators and requests of all sessions may
  // take. Everything else that is passed by reference outlives the dispatcher.
  Dispatcher(SharedState& shared, uint32_t worker, Executor& executor, const WorkerShares& memory,
             Responder::SendFunction send);
  ~Dispatcher();

  // Takes over all sessions of this worker that an earlier process of it has left. To be called
  // before the first message.
  void AdoptSessions();
  // Looks through the next 64 session records for a live session that this worker has yet to take
  // over (the gateway may have acknowledged it late), and builds one session at most. To be called
  // about sixteen times a second.
  void AdoptNext();
  // `more_waiting`: other messages have arrived already, so the request's work goes to the pool
  // instead of being executed at once.
  void Handle(IncomingMessage incoming, bool more_waiting);
  // Ends the requests whose deadline has passed; FinishCompleted answers them.
  void EndExpired();
  // Builds the session whose Attach has waited for longest, if it is due. To be called in every
  // turn of the loop.
  void BuildNext(Clock::time_point now);
  // How long the caller may wait before it calls EndExpired and BuildNext again.
  int64_t MsToNextTurn() const;
  // Answers the requests that the pool has finished.
  void FinishCompleted();
  // Ends sessions whose lease has run out at `now_ms`. To be called every kReapIntervalMs: in the
  // time by which a call is late, if it is more than a second, the process stood still, and no
  // lease runs.
  void ReapIdleSessions(int64_t now_ms);

  // From now on new work is answered with kUnavailable, and so are Attaches that wait.
  void StopAccepting();
  bool idle() const { return jobs_.empty() && attaches_.empty(); }
  size_t session_count() const { return sessions_.size(); }

 private:
  struct WaitingAttach {
    Asker from;
    std::string token;
    uint32_t index;
    uint64_t generation;
  };
  // Has the session built in its turn. A copy of an Attach that waits takes its place.
  void HandleAttach(const Asker& from, const pb::Request& request);
  // OK if the record still is that of the session to be attached.
  Status CheckAttach(const WaitingAttach& attach) const;
  // When BuildNext will find something to do.
  Clock::time_point NextBuild() const;
  Result<pb::Reply> Build(const WaitingAttach& attach);
  // Takes over the session of record `index`, where it is live and this worker's. Returns whether
  // the session was built now.
  bool AdoptIfLive(uint32_t index);
  // Builds the session that has record `index` in this generation, or finds it built.
  Result<Session*> Attach(uint32_t index, uint64_t generation);
  // Whether the token is that of a live session of this worker which could not be taken over yet.
  bool IsToBeAdopted(const std::string& token) const;
  int64_t LeaseMs() const { return shared_.header().lease_ms; }
  // The mark of the socket's thread.
  ThreadMark& own_mark() const { return shared_.marks(worker_)[0]; }
  // Forgets `session` if its record belongs to another session by now and none of its requests is
  // in flight. Returns whether it did.
  bool ForgetIfDisowned(Session* session);
  void HandleClose(const Asker& from, const std::string& token, const Deadline& deadline);
  // Closes a session that was not attached here; an Attach of it that is on its way is refused.
  Result<pb::Reply> CloseUnattached(const std::string& token);
  // Starts a job, which will reply. An error of this function is the reply instead.
  // Leaves `request` as it was.
  Status HandleSessionRequest(const Asker& from, pb::Request& request, Frame payload,
                              bool more_waiting);
  // OK if `request` may proceed. Else the error: the daemon is stopping, the request has ended its
  // worker too often, or a limit on requests is reached.
  Status Admit(const Session& session, const pb::Request& request, const Frame& payload) const;
  void Start(std::unique_ptr<RequestJob> job, bool more_waiting);
  // Has EndExpired look at the deadlines when this one has passed, or soon after.
  void SweepAfter(const Deadline& deadline);
  void Finish(RequestJob* job);
  void EndSession(Session* session);

  SharedState& shared_;
  uint32_t worker_;
  Executor& executor_;
  const WorkerShares memory_;
  SharedBytes pictures_;  // outlives the jobs that hold some of it
  ChildRecord& counters_;
  LedgerTable ledgers_;
  Responder replies_;
  bool accepting_ = true;
  pb::Request request_;                                                 // reused by every message
  std::unordered_map<std::string, std::unique_ptr<Session>> sessions_;  // by token
  std::unordered_map<RequestJob*, std::unique_ptr<RequestJob>> jobs_;
  size_t queued_bytes_ = 0;
  uint32_t painter_jobs_ = 0;
  std::deque<WaitingAttach> attaches_;          // at most one for each record
  Clock::time_point next_build_{};              // not before, while other requests come
  bool served_since_build_ = false;             // a request of a session
  uint32_t next_record_ = 0;                    // the record that AdoptNext looks at next
  int64_t adoption_failed_ms_ = INT64_MIN / 2;  // when a session could last not be taken over
  int64_t reaped_ms_ = 0;                       // when ReapIdleSessions was last called
  // When EndExpired last looked at all jobs, and when it has to look again.
  Clock::time_point last_deadline_sweep_{};
  Clock::time_point next_deadline_sweep_ = Clock::time_point::max();
};

}  // namespace b4mrl
