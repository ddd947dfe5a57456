// Which sessions a worker builds, and when: those whose Attach has come, and those that an earlier
// process of it has left.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <set>

#include "proto/base/limits.h"
#include "server/shared_memory/blame.h"
#include "server/shared_memory/session_table.h"
#include "server/worker/admission.h"
#include "server/worker/describe_session.h"
#include "server/worker/dispatcher.h"
#include "server/worker/fault_point.h"

namespace b4mrl {
namespace {

// Session records that AdoptNext looks at in one call. A record has 8 KB, so all of them at once
// would cost 0.1 ms.
constexpr uint32_t kAdoptSlice = 64;
// AdoptNext has looked at all records again by then, however busy the worker is.
constexpr int64_t kAdoptionRetryMs = 10'000;
// Bytes of an OpenReply's envelope beside the worker's description of the session.
constexpr size_t kEnvelopeRest = 1024;
// Building a session with a simulator that no other session has takes up to milliseconds of the
// socket's thread. While others' requests come, the next is built once so many times as long has
// passed, so that a client which opens ever new simulators takes a quarter of the thread at most.
constexpr int kRestAfterBuild = 3;

Status GivenUp() { return Status(StatusCode::kSessionLost, "the session was given up meanwhile"); }

// Whether a session that cannot be taken over now may be taken over later: a file or memory that
// is refused for the moment, or an earlier session of the token that still closes.
bool MayPass(const Status& status) {
  return status.code() == StatusCode::kBusy || status.code() == StatusCode::kUnavailable ||
         status.code() == StatusCode::kIoError;
}

}  // namespace

void Dispatcher::AdoptSessions() {
  // Live sessions first: whatever memory they take, they have been admitted.
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) AdoptIfLive(index);
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    SessionRecord& record = shared_.session(index);
    const uint64_t generation = record.generation;
    const SessionState state = record.state();
    // The earlier process may have answered the Attach of a session that is opening, so the gateway
    // may make the session live at any moment without another message. An error of building it here
    // is told when the Attach comes again.
    if (state == SessionState::kOpening && record.worker == worker_ && record.build_deaths == 0) {
      record.last_activity_ms.store(MonotonicMs());  // so that it is not given up while it is built
      static_cast<void>(Attach(index, generation));
      AdoptIfLive(index);
    }
  }
  // The gateway goes on meanwhile: of a session that became live behind the first look at its
  // record, the first request would find nothing, and its client would take it for lost.
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) AdoptIfLive(index);
  // And of an opening one that could not be built above, the gateway may read the answer of the
  // earlier process only now.
  adoption_failed_ms_ = MonotonicMs();
}

void Dispatcher::AdoptNext() {
  for (uint32_t i = 0; i < kAdoptSlice; ++i) {
    if (AdoptIfLive(next_record_++ % limits::kMaxSessions)) return;
  }
}

bool Dispatcher::AdoptIfLive(uint32_t index) {
  SessionRecord& record = shared_.session(index);
  const uint64_t generation = record.generation;
  if (record.state() != SessionState::kLive || record.worker != worker_) return false;
  const auto found = sessions_.find(std::string(SessionToken(record)));
  if (found != sessions_.end() && found->second->generation() == generation) return false;
  if (record.closing_generation == generation) {
    record.Close(generation);  // what its Close waited for has ended with the earlier process
    return true;
  }
  const Status status = Attach(index, generation).status();
  if (status.ok()) {
    record.last_activity_ms.store(MonotonicMs());  // its clients could not reach it meanwhile
  } else if (MayPass(status) && record.last_activity_ms >= MonotonicMs() - LeaseMs()) {
    adoption_failed_ms_ = MonotonicMs();
  } else {
    spdlog::error("session {} is lost: {}", index, status.ToString());
    record.Close(generation);
  }
  return true;
}

bool Dispatcher::IsToBeAdopted(const std::string& token) const {
  // Without this, every request with an unknown token would cost a search.
  if (MonotonicMs() - adoption_failed_ms_ > kAdoptionRetryMs) return false;
  const std::optional<uint32_t> index = SessionTable(shared_).Find(token);
  return index && shared_.session(*index).worker == worker_ &&
         shared_.session(*index).state() == SessionState::kLive;
}

void Dispatcher::HandleAttach(const Asker& from, const pb::Request& request) {
  const WaitingAttach attach{from, request.session_token(), request.attach().session_index(),
                             request.attach().generation()};
  if (const Status status = CheckAttach(attach); !status.ok()) return replies_.Reply(from, status);
  // So that the record is not freed while the session waits.
  shared_.session(attach.index).last_activity_ms.store(MonotonicMs());
  const auto earlier = std::ranges::find(attaches_, attach.index, &WaitingAttach::index);
  if (earlier == attaches_.end()) return attaches_.push_back(attach);
  if (earlier->generation != attach.generation) replies_.Reply(earlier->from, GivenUp());
  *earlier = attach;
}

Status Dispatcher::CheckAttach(const WaitingAttach& attach) const {
  if (!accepting_) return Stopping();
  if (attach.index >= limits::kMaxSessions) {
    return InvalidNumber("session_index", attach.index,
                         fmt::format("0 to {}", limits::kMaxSessions - 1));
  }
  const SessionRecord& record = shared_.session(attach.index);
  // A client can guess index and generation, but learns nothing of sessions that are not its own.
  const bool is_its_own =
      record.generation == attach.generation && SessionToken(record) == attach.token;
  return is_its_own ? Status() : GivenUp();
}

Clock::time_point Dispatcher::NextBuild() const {
  if (attaches_.empty()) return Clock::time_point::max();
  const bool others_wait = served_since_build_ || !jobs_.empty();
  return others_wait ? next_build_ : Clock::time_point{};
}

void Dispatcher::BuildNext(Clock::time_point now) {
  if (attaches_.empty() || NextBuild() > now) return;
  const WaitingAttach attach = std::move(attaches_.front());
  attaches_.pop_front();
  const Clock::time_point start = Clock::now();
  replies_.Reply(attach.from, Build(attach));
  const Clock::time_point end = Clock::now();
  next_build_ = end + kRestAfterBuild * (end - start);
  served_since_build_ = false;
}

Result<pb::Reply> Dispatcher::Build(const WaitingAttach& attach) {
  B4MRL_RETURN_IF_ERROR(CheckAttach(attach));  // it may have been given up while it waited
  SessionRecord& record = shared_.session(attach.index);
  record.last_activity_ms.store(MonotonicMs());
  B4MRL_ASSIGN_OR_RETURN(Session * session, Attach(attach.index, attach.generation));
  pb::Reply reply;
  DescribeSession(*session, reply.mutable_attach());
  const size_t bytes = reply.ByteSizeLong();
  if (bytes + kEnvelopeRest <= limits::kMaxEnvelopeBytes) return reply;
  // The session's description does not fit the reply to Open.
  record.Close(session->generation());
  sessions_.erase(std::string(session->token()));
  return Status(StatusCode::kInvalidArgument,
                fmt::format("the session's description has {} bytes, allowed: {}", bytes,
                            limits::kMaxEnvelopeBytes - kEnvelopeRest));
}

bool Dispatcher::ForgetIfDisowned(Session* session) {
  if (session->owns_record() || !session->in_flight().empty()) return false;
  sessions_.erase(std::string(session->token()));
  return true;
}

Result<Session*> Dispatcher::Attach(uint32_t index, uint64_t generation) {
  SessionRecord& record = shared_.session(index);
  const SessionState state = record.state();
  if ((state != SessionState::kOpening && state != SessionState::kLive) ||
      record.worker != worker_) {
    return Status(StatusCode::kSessionLost, "the session was closed, or is not this worker's");
  }
  const std::string token(SessionToken(record));
  const auto found = sessions_.find(token);
  if (found != sessions_.end()) {
    const bool is_this = found->second->generation() == generation;
    if (is_this && !found->second->closing) return found->second.get();
    if (is_this || !ForgetIfDisowned(found->second.get())) {
      return Status(StatusCode::kBusy, "an earlier session of this token is still closing");
    }
  }
  if (SessionIsRefused(record)) {
    return Status(StatusCode::kInternal, "building this session ended its worker again and again");
  }
  const ScopedMark mark = ScopedMark::OfSession(&own_mark(), index, generation);
  ReachFaultPoint(FaultPoint::kBeforeAttach, record.lane_count, generation);
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                         Session::Build(shared_, index, generation));
  if (state == SessionState::kOpening) {
    std::set<const Simulator*> simulators = {&session->simulator()};
    for (const auto& [other_token, other] : sessions_) simulators.insert(&other->simulator());
    B4MRL_RETURN_IF_ERROR(CheckSimulators(session->simulator(), simulators,
                                          executor_.thread_count(), memory_.simulators));
  }
  session->pictures = &pictures_;
  record.build_deaths.store(0);
  executor_.ForgetDebts(index);
  return (sessions_[token] = std::move(session)).get();
}

}  // namespace b4mrl
