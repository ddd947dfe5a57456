#include "server/worker/dispatcher.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>

#include "proto/base/limits.h"
#include "server/process/child.h"
#include "server/replies/pending_request.h"
#include "server/replies/reply.h"
#include "server/replies/request_kinds.h"
#include "server/shared_memory/blame.h"
#include "server/shared_memory/session_table.h"
#include "server/worker/admission.h"
#include "server/worker/handlers.h"

namespace b4mrl {
namespace {

// Deadlines are checked at most this often, because each check looks at all requests.
constexpr std::chrono::milliseconds kDeadlineSweepInterval(20);
// A longer delay of ReapIdleSessions means that this process stood still.
constexpr int64_t kPausedMs = 1'000;
struct Handler {
  pb::Request::PayloadCase payload;
  // Whether a copy is not told by the bytes of its arrays alone, because the request says more, or
  // names them in any order. A hash of it takes time that a step is spared.
  bool has_fields;
  // Makes the job; null for a request that the dispatcher answers itself.
  std::unique_ptr<RequestJob> (*make_job)(JobInput);
};
constexpr Handler kHandlers[] = {
    {pb::Request::kAttach, true, nullptr},        {pb::Request::kClose, false, nullptr},
    {pb::Request::kStep, false, NewStepJob},      {pb::Request::kReset, false, NewResetJob},
    {pb::Request::kQuery, true, NewQueryJob},     {pb::Request::kSnapshot, true, NewSnapshotJob},
    {pb::Request::kRestore, true, NewRestoreJob}, {pb::Request::kRender, true, NewRenderJob},
};
static_assert(HandlesAll(Server::kWorker, kHandlers));

pb::Reply Closed() {
  pb::Reply reply;
  reply.mutable_close();
  return reply;
}

Status NoSuchSession() {
  return Status(StatusCode::kSessionLost,
                "no such session: it was closed, its lease ran out, or it was opened on another "
                "worker");
}

bool SameBytes(const Frame& a, const Frame& b) { return a.view() == b.view(); }

}  // namespace

Dispatcher::Dispatcher(SharedState& shared, uint32_t worker, Executor& executor,
                       const WorkerShares& memory, Responder::SendFunction send)
    : shared_(shared),
      worker_(worker),
      executor_(executor),
      memory_(memory),
      pictures_(memory.pictures),
      counters_(shared.child(kFirstWorkerChild + worker)),
      ledgers_(shared),
      replies_({counters_.requests, counters_.errors}, std::move(send)) {}

Dispatcher::~Dispatcher() = default;

void Dispatcher::Handle(IncomingMessage incoming, bool more_waiting) {
  const std::optional<Asker> asker = replies_.Read(incoming, &request_);
  if (!asker) return;
  const Asker& from = *asker;
  switch (request_.payload_case()) {
    case pb::Request::kAttach:
      return HandleAttach(from, request_);
    case pb::Request::kClose:
      return HandleClose(from, request_.session_token(), DeadlineOf(request_));
    default:
      const Status status =
          HandleSessionRequest(from, request_, std::move(incoming.message.payload), more_waiting);
      if (!status.ok()) replies_.Reply(from, status);
  }
}

Result<pb::Reply> Dispatcher::CloseUnattached(const std::string& token) {
  const SessionTable table(shared_);
  const std::optional<uint32_t> index = table.Find(token);
  if (!index) return Closed();  // the session is closed already
  SessionRecord& record = shared_.session(*index);
  const uint64_t generation = record.generation;
  if (table.Holds(*index, token)) {  // the token has not changed meanwhile, nor has the generation
    if (record.worker != worker_) {
      return Status(StatusCode::kSessionLost, "the session lives on another worker");
    }
    record.Close(generation);
  }
  return Closed();
}

void Dispatcher::HandleClose(const Asker& from, const std::string& token,
                             const Deadline& deadline) {
  const auto found = sessions_.find(token);
  if (found == sessions_.end() || ForgetIfDisowned(found->second.get())) {
    return replies_.Reply(from, CloseUnattached(token));
  }
  Session* session = found->second.get();
  if (!session->AddClose({from, deadline})) {
    return replies_.Reply(
        from, Status(StatusCode::kLimitExceeded,
                     fmt::format("{} Closes of the session wait already, at most {}",
                                 limits::kMaxRequestsInFlight, limits::kMaxRequestsInFlight)));
  }
  session->closing = true;
  session->record().closing_generation.store(session->generation());
  if (session->in_flight().empty()) return EndSession(session);
  SweepAfter(deadline);
}

Status Dispatcher::HandleSessionRequest(const Asker& from, pb::Request& request, Frame payload,
                                        bool more_waiting) {
  const Handler* handler = FindRow(kHandlers, request.payload_case());
  if (handler == nullptr) return NotAnswered(Server::kWorker);
  const auto found = sessions_.find(request.session_token());
  if (found == sessions_.end() && IsToBeAdopted(request.session_token())) {
    return Status(StatusCode::kUnavailable, "the session is yet to be taken over; try again");
  }
  if (found == sessions_.end() || !found->second->live()) return NoSuchSession();
  Session* session = found->second.get();
  session->record().last_activity_ms.store(MonotonicMs(), std::memory_order_relaxed);

  const size_t contents = handler->has_fields ? HashOfContents(&request) : 0;
  const auto running = session->in_flight().find(request.request_id());
  if (running != session->in_flight().end()) {
    RequestJob* job = running->second;
    if (job->kind() == request.payload_case() && job->contents == contents &&
        SameBytes(job->payload(), payload)) {
      job->sender = from.peer;  // resent after a reconnection: one execution, one reply
      return Status();
    }
    return OtherContents(request.request_id());
  }
  // A Close waits for what is under way, so a copy of that has an answer all the same.
  if (session->closing) return NoSuchSession();
  B4MRL_RETURN_IF_ERROR(Admit(*session, request, payload));
  std::unique_ptr<RequestJob> job = handler->make_job({session, &request, std::move(payload)});
  {
    const ScopedMark mark =
        ScopedMark::OfRequest(&own_mark(), session->index(), request.request_id());
    B4MRL_RETURN_IF_ERROR(job->Prepare(request));
  }
  job->held_bytes = job->payload().size() + job->planned_reply_bytes();
  B4MRL_RETURN_IF_ERROR(CheckHeldBytes(queued_bytes_, job->held_bytes, memory_.requests));
  job->sender = from.peer;
  job->contents = contents;
  job->received = Clock::now();
  job->deadline = DeadlineOf(request);
  Start(std::move(job), more_waiting);
  return Status();
}

Status Dispatcher::Admit(const Session& session, const pb::Request& request,
                         const Frame& payload) const {
  if (!accepting_) return Stopping();
  return CheckRequest(session, request, payload, {jobs_.size(), queued_bytes_, painter_jobs_},
                      memory_.requests);
}

void Dispatcher::StopAccepting() {
  accepting_ = false;
  for (const WaitingAttach& attach : attaches_) replies_.Reply(attach.from, Stopping());
  attaches_.clear();
}

void Dispatcher::Start(std::unique_ptr<RequestJob> owned, bool more_waiting) {
  served_since_build_ = true;
  RequestJob* job = owned.get();
  Session& session = job->owner();
  jobs_[job] = std::move(owned);
  queued_bytes_ += job->held_bytes;
  if (job->waits_for_painter()) ++painter_jobs_;
  session.in_flight()[job->request_id()] = job;
  for (const uint32_t lane : job->busy_lanes()) session.lane(lane).busy = job;
  const bool short_work =
      job->items == 0 ||
      (job->items == 1 && job->work_kind == WorkKind::kLanes && !job->cost->too_long_for_bites());
  if (short_work && !more_waiting && executor_.idle()) {
    executor_.RunHere(job);
    Finish(job);
  } else if (job->items == 0) {
    job->Complete();
    Finish(job);
  } else {
    SweepAfter(job->deadline);
    executor_.Submit(job);
  }
}

void Dispatcher::SweepAfter(const Deadline& deadline) {
  const auto earliest = last_deadline_sweep_ + kDeadlineSweepInterval;
  next_deadline_sweep_ = std::min(next_deadline_sweep_, std::max(deadline.at(), earliest));
}

void Dispatcher::EndExpired() {
  const Clock::time_point now = Clock::now();
  if (now < next_deadline_sweep_) return;
  Clock::time_point next = Clock::time_point::max();
  for (const auto& [job, owned] : jobs_) {
    if (job->deadline.at() > now) {
      next = std::min(next, job->deadline.at());
    } else {
      executor_.EndExpired(job);
    }
  }
  for (const auto& [token, session] : sessions_) {
    for (const Asker& late : session->TakeLateCloses(now, &next)) {
      replies_.Reply(late, Status(StatusCode::kDeadlineExceeded,
                                  "the session is closed once its last request has ended"));
    }
  }
  last_deadline_sweep_ = now;
  next_deadline_sweep_ = std::max(next, now + kDeadlineSweepInterval);
}

int64_t Dispatcher::MsToNextTurn() const {
  const Clock::time_point next = std::min(next_deadline_sweep_, NextBuild());
  if (next == Clock::time_point::max()) return limits::kMaxDeadlineMs;
  const auto left = next - Clock::now();
  return std::max<int64_t>(0, std::chrono::ceil<std::chrono::milliseconds>(left).count());
}

void Dispatcher::FinishCompleted() {
  for (RequestJob* job : executor_.TakeCompleted()) Finish(job);
}

void Dispatcher::Finish(RequestJob* job) {
  Session& session = job->owner();
  for (const uint32_t lane : job->busy_lanes()) {
    session.RefreshLane(lane);
    session.lane(lane).busy = nullptr;
  }
  session.in_flight().erase(job->request_id());
  const LedgerCounts done = job->done();
  session.record().steps.fetch_add(done.steps, std::memory_order_relaxed);
  session.record().last_activity_ms.store(MonotonicMs(), std::memory_order_relaxed);
  counters_.steps.fetch_add(done.steps, std::memory_order_relaxed);
  counters_.query_rows.fetch_add(done.query_rows, std::memory_order_relaxed);
  ledgers_.Add(session.request().ledger(), done);
  if (job->failed()) counters_.errors.fetch_add(1, std::memory_order_relaxed);
  if (Result<Message> reply = job->TakeReply(); reply.ok()) {
    replies_.Send(job->sender, std::move(*reply));
  } else {
    replies_.Reply({job->sender, job->request_id()}, reply.status());
  }
  queued_bytes_ -= job->held_bytes;
  if (job->waits_for_painter()) --painter_jobs_;
  jobs_.erase(job);
  if (session.closing && session.in_flight().empty()) EndSession(&session);
}

void Dispatcher::EndSession(Session* session) {
  const auto closes = std::move(session->pending_closes);
  session->record().Close(session->generation());
  const std::string token = session->token();
  sessions_.erase(token);
  for (const Session::PendingClose& close : closes) replies_.Reply(close.from, Closed());
}

void Dispatcher::ReapIdleSessions(int64_t now_ms) {
  // While this process stood still (SIGSTOP, a container that was paused), no request could come to
  // it: those that waited meanwhile are only read after this.
  const int64_t stood_still_ms = reaped_ms_ == 0 ? 0 : now_ms - reaped_ms_ - kReapIntervalMs;
  reaped_ms_ = now_ms;
  if (stood_still_ms > kPausedMs) {
    for (const auto& [token, session] : sessions_) {
      if (!session->owns_record()) continue;
      std::atomic<int64_t>& last = session->record().last_activity_ms;
      last.store(std::min(now_ms, last.load() + stood_still_ms));
    }
  }
  const int64_t oldest = now_ms - LeaseMs();
  std::vector<Session*> expired;
  for (const auto& [token, session] : sessions_) {
    const bool idle = session->in_flight().empty() &&
                      session->record().last_activity_ms.load(std::memory_order_relaxed) < oldest;
    if (idle || !session->owns_record()) expired.push_back(session.get());
  }
  for (Session* session : expired) {
    if (!session->owns_record()) {
      ForgetIfDisowned(session);
      continue;
    }
    // Not for the log of every day: a client that opens sessions and leaves would write it.
    spdlog::debug("session {} ends: its lease ran out", session->index());
    EndSession(session);
  }
}

}  // namespace b4mrl
