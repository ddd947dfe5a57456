#include "server/gateway/openings.h"

#include <xxhash.h>

#include <algorithm>
#include <optional>

#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/gateway/describe.h"
#include "server/gateway/open_request.h"
#include "server/perturbations/list.h"
#include "server/replies/pending_request.h"
#include "server/replies/reply.h"
#include "server/shared_memory/open_record.h"

namespace b4mrl {
namespace {

// The record of an opening is freed when no client has repeated its Open for this long.
constexpr int64_t kAbandonedMs = 60'000;
// Interval at which the compiled models of live sessions are marked as used.
constexpr int64_t kUseIntervalMs = 60'000;

uint64_t HashOf(const pb::OpenRequest& open) {
  const std::string bytes = open.SerializeAsString();
  return XXH3_64bits(bytes.data(), bytes.size());
}

Status Damaged() { return Status(StatusCode::kSessionLost, "the session's record is damaged"); }

}  // namespace

Openings::Openings(SharedState& shared, std::vector<DealerSocket> workers, Options options,
                   DataFolder& data_folder, ReplyFunction reply)
    : shared_(shared),
      table_(shared),
      worker_ports_(std::move(options.worker_ports)),
      data_folder_(data_folder),
      reply_(std::move(reply)),
      store_(std::move(options.models)),
      models_(
          {.short_places = limits::kModelCompilers - 1, .long_places = 1, .places_of_client = 1},
          limits::kQuickModelMs) {
  for (DealerSocket& socket : workers) workers_.push_back({std::move(socket)});
  worker_ports_.resize(workers_.size());
}

void Openings::Open(const Asker& from, const pb::Request& request) {
  const std::string& token = request.session_token();
  const uint64_t contents = HashOf(request.open());
  const Result<const Waiting*> copied = FindCopied(from, token, contents);
  if (copied.ok() && *copied != nullptr) return AskAgain((*copied)->generation);
  Status status = copied.ok() ? Admit(from) : copied.status();
  if (!status.ok()) return reply_(from, status);
  const uint64_t number = Enter(from, request, contents);
  const std::string file = ModelFileOf(request.open());
  if (file.empty() || table_.Find(token)) {
    status = AskWorker(number, request.open(), "");
  } else {
    status = CompileModel(number, request, file);
  }
  if (!status.ok()) Leave(number, status);
}

void Openings::Close(const std::string& token) {
  std::vector<uint64_t> closed;
  for (const auto& [number, waiting] : waiting_) {
    if (waiting.token == token) closed.push_back(number);
  }
  for (const uint64_t number : closed) {
    Leave(number, Status(StatusCode::kSessionLost, "the session was closed before it was open"));
  }
}

void Openings::RefuseAll() {
  while (!waiting_.empty()) {
    Leave(waiting_.begin()->first, Stopping());
  }
}

Result<const Openings::Waiting*> Openings::FindCopied(const Asker& from, const std::string& token,
                                                      uint64_t contents) const {
  const auto peer = peers_.find(from.peer);
  if (peer == peers_.end()) return nullptr;
  const auto number = peer->second.find(from.request_id);
  if (number == peer->second.end()) return nullptr;
  const Waiting& waiting = waiting_.at(number->second);
  if (waiting.token == token && waiting.contents == contents) return &waiting;
  return OtherContents(from.request_id);
}

void Openings::AskAgain(uint64_t generation) {
  if (attaches_.contains(generation)) unsent_.insert(generation);
}

Status Openings::Admit(const Asker& from) const {
  const auto peer = peers_.find(from.peer);
  const size_t of_peer = peer == peers_.end() ? 0 : peer->second.size();
  return CheckWaiting("Opens", {waiting_.size(), of_peer},
                      {limits::kMaxPendingOpens, limits::kMaxPendingOpensOfPeer});
}

uint64_t Openings::Enter(const Asker& from, const pb::Request& request, uint64_t contents) {
  const uint64_t number = next_number_++;
  const Clock::time_point end = DeadlineOf(request).at();
  waiting_[number] = {from, request.session_token(), contents, end};
  peers_[from.peer][from.request_id] = number;
  deadlines_.emplace(end, number);
  return number;
}

void Openings::Leave(uint64_t number, const Result<pb::Reply>& reply) {
  const auto found = waiting_.find(number);
  const Waiting waiting = std::move(found->second);
  waiting_.erase(found);
  if (const auto attach = attaches_.find(waiting.generation); attach != attaches_.end()) {
    attach->second.waiting.erase(number);
  }
  deadlines_.erase({waiting.end, number});
  const auto peer = peers_.find(waiting.from.peer);
  peer->second.erase(waiting.from.request_id);
  if (peer->second.empty()) peers_.erase(peer);
  reply_(waiting.from, reply);
}

Status Openings::CompileModel(uint64_t number, const pb::Request& request,
                              const std::string& file) {
  // What can be refused is refused before anything is compiled.
  pb::OpenRequest open = request.open();
  B4MRL_RETURN_IF_ERROR(CompleteOpen(request.session_token(), &open));
  B4MRL_RETURN_IF_ERROR(FindEnvironment(open.environment()).status());
  if (!IsModelFileName(file)) {
    return InvalidArgument("model", file, "the name of a file in the models folder");
  }
  const RoutingId& peer = waiting_.at(number).from.peer;
  B4MRL_RETURN_IF_ERROR(CheckWaiting("models to be compiled",
                                     {models_.Backlog(), models_.BacklogOf(peer)},
                                     {limits::kMaxPendingModels, limits::kMaxPendingModelsOfPeer}));
  const auto compile = [this, environment = open.environment(),
                        file](const std::atomic<bool>& cancelled) {
    return store_.Compile(environment, file, cancelled);
  };
  const auto waits = [this, number] { return waiting_.contains(number); };
  const auto done = [this, number, open = request.open()](const Result<std::string>& compiled) {
    if (!waiting_.contains(number)) return;  // it was answered at its deadline
    const Status status = compiled.ok() ? AskWorker(number, open, *compiled) : compiled.status();
    if (!status.ok()) Leave(number, status);
  };
  // No two Opens share a compilation: the file may change between them, and the store remembers
  // what came of a file that has not changed.
  models_.Submit(std::to_string(number), /*bytes=*/0, compile, {peer, waits, done});
  return Status();
}

Result<uint32_t> Openings::FindOrAllocate(const Waiting& waiting, const pb::OpenRequest& open,
                                          const std::string& compiled_model) {
  const std::string& token = waiting.token;
  if (const std::optional<uint32_t> index = table_.Find(token)) {
    if (shared_.session(*index).request_hash == waiting.contents) return *index;
    return Status(StatusCode::kInvalidArgument,
                  "session_token belongs to a session with other contents, allowed: a new token");
  }
  pb::OpenRequest complete = open;
  B4MRL_RETURN_IF_ERROR(CompleteOpen(token, &complete));
  complete.set_compiled_model(compiled_model);
  const std::string bytes = complete.SerializeAsString();
  return table_.Allocate({token, bytes, waiting.contents, complete.num_envs()});
}

Status Openings::AskWorker(uint64_t number, const pb::OpenRequest& open,
                           const std::string& compiled_model) {
  Waiting& waiting = waiting_.at(number);
  B4MRL_ASSIGN_OR_RETURN(const uint32_t index, FindOrAllocate(waiting, open, compiled_model));
  SessionRecord& record = shared_.session(index);
  record.last_activity_ms.store(MonotonicMs());
  const uint32_t worker = record.worker;
  if (worker >= workers_.size()) return Damaged();
  waiting.generation = record.generation;
  const auto [attach, is_new] = attaches_.try_emplace(waiting.generation, Attach{index, worker});
  attach->second.waiting.insert(number);
  if (is_new) unsent_.insert(waiting.generation);
  return Status();
}

bool Openings::Send(uint64_t generation) {
  const auto attach = attaches_.find(generation);
  if (attach == attaches_.end()) return true;  // the session was closed meanwhile
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(generation);
  *request.mutable_session_token() = SessionToken(shared_.session(attach->second.session_index));
  request.mutable_attach()->set_session_index(attach->second.session_index);
  request.mutable_attach()->set_generation(generation);
  Result<Frame> envelope = SerializeEnvelope(request);
  return envelope.ok() &&
         workers_[attach->second.worker].socket.Send({std::move(*envelope), Frame()}).ok();
}

void Openings::Pump() {
  models_.Run();
  for (uint32_t worker = 0; worker < workers_.size(); ++worker) ReadWorker(worker);
  // An Attach that finds its worker's queue full is sent in the next turn.
  std::erase_if(unsent_, [this](uint64_t generation) { return Send(generation); });
  while (!deadlines_.empty() && deadlines_.begin()->first <= Clock::now()) {
    const uint64_t number = deadlines_.begin()->second;
    // The record is kept: the worker may still acknowledge, and the client may ask again.
    const bool has_record = waiting_.at(number).generation != 0;
    Leave(number, Status(StatusCode::kDeadlineExceeded,
                         has_record ? "the worker did not acknowledge in time"
                                    : "the model was not compiled in time"));
  }
}

void Openings::ReadWorker(uint32_t index) {
  Worker& worker = workers_[index];
  while (const std::optional<Message> message = worker.socket.TryReceive()) {
    pb::Reply answer;
    if (!ParseEnvelope(message->envelope, &answer).ok()) continue;
    const auto attach = attaches_.find(answer.request_id());
    // An answer may be late by a worker.
    if (attach != attaches_.end() && attach->second.worker == index) Finish(attach, answer);
  }
  const uint32_t connections = worker.socket.connections();
  if (connections == worker.connections) return;
  const bool had_none = std::exchange(worker.connections, connections) == 0;
  // What was sent before the first connection is still queued, unless that has ended meanwhile.
  if (had_none && connections == 1) return;
  for (const auto& [generation, attach] : attaches_) {
    if (attach.worker == index) unsent_.insert(generation);
  }
}

bool Openings::MoveOn(uint64_t generation, Attach* attach) {
  SessionRecord& record = shared_.session(attach->session_index);
  const bool is_opening =
      record.generation == generation && record.state() == SessionState::kOpening;
  if (!is_opening) return false;
  do {
    if (++attach->refusals >= workers_.size()) return false;
    attach->worker = (attach->worker + 1) % static_cast<uint32_t>(workers_.size());
  } while (shared_.worker_is_down(attach->worker));
  record.worker.store(attach->worker);
  unsent_.insert(generation);
  return true;
}

void Openings::Finish(Attaches::iterator found, const pb::Reply& answer) {
  const uint64_t generation = found->first;
  // Another worker may have the memory that this one lacks.
  if (GetStatus(answer.status()).code() == StatusCode::kLimitExceeded &&
      MoveOn(generation, &found->second)) {
    return;
  }
  const Attach attach = std::move(found->second);
  attaches_.erase(found);
  const Result<pb::Reply> reply = Conclude(generation, attach, answer);
  for (const uint64_t number : attach.waiting) Leave(number, reply);
}

Result<pb::Reply> Openings::Conclude(uint64_t generation, const Attach& attach,
                                     const pb::Reply& answer) {
  const SessionRecord& record = shared_.session(attach.session_index);
  const bool is_its_own = record.generation == generation;
  if (const Status status = GetStatus(answer.status()); !status.ok()) {
    // No worker holds the record of a session that is opening; a live session keeps its record.
    if (is_its_own && record.state() == SessionState::kOpening) table_.Free(attach.session_index);
    return status;
  }
  // If no Open waits, the session does not become live: the client asks again, or Reap frees the
  // record.
  if (attach.waiting.empty()) return Status(StatusCode::kDeadlineExceeded, "nobody waits");
  if (!is_its_own || !table_.MakeLive(attach.session_index)) {
    return Status(StatusCode::kSessionLost, "the session was closed or given up meanwhile");
  }
  const Result<pb::OpenRequest> request = OpenRequestOf(record);
  if (!request.ok()) return Damaged();
  pb::Reply reply;
  pb::OpenReply* opened = reply.mutable_open();
  DescribeOpen(*request, answer.attach(), opened);
  opened->mutable_port()->set_tcp(worker_ports_[attach.worker].tcp);
  opened->mutable_port()->set_ipc(worker_ports_[attach.worker].ipc);
  opened->mutable_port()->set_door(worker_ports_[attach.worker].door);
  return reply;
}

void Openings::Reap() {
  std::erase_if(attaches_, [this](const auto& item) {
    const auto& [generation, attach] = item;
    SessionRecord& record = shared_.session(attach.session_index);
    const bool is_its_own =
        record.generation == generation && record.state() != SessionState::kFree;
    if (is_its_own && !attach.waiting.empty()) record.last_activity_ms.store(MonotonicMs());
    return !is_its_own && attach.waiting.empty();
  });
  table_.Reap(kAbandonedMs);
  if (const int64_t now = MonotonicMs(); now >= next_use_ms_) {
    MarkModelsAsUsed();
    next_use_ms_ = now + kUseIntervalMs;
  }
}

void Openings::MarkModelsAsUsed() {
  std::vector<std::string> models;
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = shared_.session(index);
    if (record.state() != SessionState::kLive) continue;
    const Result<pb::OpenRequest> request = OpenRequestOf(record);
    if (!request.ok() || request->compiled_model().empty()) continue;
    models.push_back(request->compiled_model());
  }
  if (models.empty()) return;
  data_folder_.TryRun([models] {
    for (const std::string& model : models) ModelStore::MarkAsUsed(model);
  });
}

int64_t Openings::wait_ms(int64_t longest_ms) const {
  if (deadlines_.empty()) return longest_ms;
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(deadlines_.begin()->first - Clock::now());
  return std::clamp<int64_t>(left.count(), 0, longest_ms);
}

void Openings::AppendSockets(std::vector<void*>* sockets) const {
  for (const Worker& worker : workers_) {
    sockets->push_back(worker.socket.handle());
    sockets->push_back(worker.socket.monitor_handle());
  }
}

}  // namespace b4mrl
