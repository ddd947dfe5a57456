// The gateway: Hello, the catalogue, opening of sessions and the daemon's status. It keeps nothing
// that it could not read from shared memory again, and no step passes through it but those of
// clients that reach no other port (server/relay.h).
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <xxhash.h>

#include <memory>
#include <unordered_map>

#include "proto/base/limits.h"
#include "server/child.h"
#include "server/describe.h"
#include "server/environments/list.h"
#include "server/model_store.h"
#include "server/open_request.h"
#include "server/relay.h"
#include "server/session_table.h"
#include "server/status_report.h"

namespace b4mrl {
namespace {

constexpr int64_t kFlushMs = 1'000;
constexpr int64_t kReapIntervalMs = 1'000;
// An opening that no client repeats for this long is taken back.
constexpr int64_t kAbandonedMs = 60'000;
// What a child sent before it ended may take so long to arrive here.
constexpr int64_t kLastWordsMs = 100;
// An Attach that ends its worker is not sent a third time.
constexpr uint32_t kMaxAttachAttempts = 2;

// An Open that waits for its worker's acknowledgement.
struct PendingOpen {
  RoutingId sender;
  uint64_t request_id = 0;
  uint32_t session_index = 0;
  uint64_t generation = 0;  // of the record then
  uint32_t worker = 0;
  uint32_t attempts = 1;
  Deadline deadline = Deadline::AfterMs(0);
};

// The gateway's connection to an environment worker.
struct WorkerLink {
  DealerSocket socket;
  uint32_t connections = 0;
};

std::string ModelsFolder(const ChildOptions& options) {
  return options.models_folder.empty() ? DefaultModelsFolder() : options.models_folder;
}

class Gateway {
 public:
  Gateway(ChildContext& context, Context& sockets, RouterSocket socket,
          std::vector<WorkerLink> links)
      : context_(context),
        socket_(std::move(socket)),
        links_(std::move(links)),
        table_(context.shared()),
        status_(context.shared(), context.options().data_folder),
        models_({ModelsFolder(context.options()), context.options().data_folder}),
        relay_(sockets, context.shared(),
               {context.options().worker_addresses, context.options().dataset_address},
               [this](const RoutingId& client, Message reply) {
                 return socket_.Send(client, std::move(reply));
               }) {}

  void Run();

 private:
  struct Envelope {
    RoutingId sender;
    uint64_t request_id = 0;
  };
  void Handle(IncomingMessage incoming);
  void HandleHello(const Envelope& from);
  void HandleOpen(const Envelope& from, pb::Request* request);
  // Opens once the model that a user wrote is compiled.
  void CompileModel(const Envelope& from, const pb::Request& request, const std::string& file);
  void StartOpen(const Envelope& from, const std::string& token, const pb::OpenRequest& open,
                 const std::string& compiled_model, const Deadline& deadline);
  // Passes on what another process answers.
  void HandleForeign(const Envelope& from, Message message);
  Result<uint32_t> FindOrAllocate(const std::string& token, const pb::OpenRequest& open,
                                  const std::string& compiled_model);
  void SendAttach(uint64_t id, const PendingOpen& open);
  void ReadWorker(uint32_t worker);
  void FinishOpen(uint64_t id, const pb::Reply& attach);
  // Frees the record of a session that no worker holds. A live one (asked for again) keeps its own.
  void FreeUnopened(const PendingOpen& open);
  void RepeatAttaches(uint32_t worker);
  void DropExpiredOpens();
  void Wait();
  // While draining: all others have ended, whose clients are told so here.
  bool MayLeave();

  void Reply(const Envelope& to, const Status& error);
  void Reply(const Envelope& to, pb::Reply reply);

  ChildContext& context_;
  RouterSocket socket_;
  std::vector<WorkerLink> links_;
  SessionTable table_;
  StatusReport status_;
  ModelStore models_;
  Relay relay_;
  std::optional<Deadline> last_words_;               // set once all other children have ended
  pb::Request request_;                              // reused
  std::unordered_map<uint64_t, PendingOpen> opens_;  // by the Attach's request id
  uint64_t next_attach_id_ = 1;
};

void Gateway::Reply(const Envelope& to, const Status& error) {
  context_.record().errors.fetch_add(1, std::memory_order_relaxed);
  pb::Reply reply;
  SetStatus(error, reply.mutable_status());
  Reply(to, std::move(reply));
}

void Gateway::Reply(const Envelope& to, pb::Reply reply) {
  reply.set_protocol_version(limits::kProtocolVersion);
  reply.set_request_id(to.request_id);
  reply.mutable_status();
  Result<Frame> envelope = SerializeEnvelope(reply);
  if (!envelope.ok()) return Reply(to, envelope.status());
  // A client that is gone asks again when it is back.
  (void)socket_.Send(to.sender, Message{std::move(*envelope), Frame()});
}

void Gateway::Handle(IncomingMessage incoming) {
  context_.record().requests.fetch_add(1, std::memory_order_relaxed);
  Envelope from{std::move(incoming.sender), 0};
  request_.Clear();
  if (const Status status = ParseEnvelope(incoming.message.envelope, &request_); !status.ok()) {
    return Reply(from, status);
  }
  from.request_id = request_.request_id();
  if (request_.protocol_version() != limits::kProtocolVersion) {
    return Reply(from, VersionMismatch(request_.protocol_version()));
  }
  pb::Reply reply;
  switch (request_.payload_case()) {
    case pb::Request::kHello:
      return HandleHello(from);
    case pb::Request::kCatalogue:
      DescribeCatalogue(ModelsFolder(context_.options()), reply.mutable_catalogue());
      return Reply(from, std::move(reply));
    case pb::Request::kServerStatus:
      status_.Fill(reply.mutable_server_status());
      return Reply(from, std::move(reply));
    case pb::Request::kOpen:
      return HandleOpen(from, &request_);
    case pb::Request::kAttach:
    case pb::Request::PAYLOAD_NOT_SET:
      return Reply(from, Status(StatusCode::kUnsupported,
                                "the gateway answers Hello, Catalogue, ServerStatus and Open, and "
                                "relays what sessions and datasets answer"));
    default:
      return HandleForeign(from, std::move(incoming.message));
  }
}

void Gateway::HandleForeign(const Envelope& from, Message message) {
  if (context_.draining()) {
    return Reply(from, Status(StatusCode::kUnavailable, "the daemon is stopping"));
  }
  const Status status = relay_.Forward(from.sender, request_, std::move(message));
  if (status.ok()) return;
  if (!request_.has_close() || status.code() != StatusCode::kSessionLost) {
    return Reply(from, status);
  }
  pb::Reply closed;  // a session that is not there counts as closed
  closed.mutable_close();
  Reply(from, std::move(closed));
}

void Gateway::HandleHello(const Envelope& from) {
  pb::Reply reply;
  pb::HelloReply* hello = reply.mutable_hello();
  DescribeServer(context_.shared().header().lease_ms, hello);
  hello->mutable_dataset_port()->set_tcp(context_.options().dataset_port.tcp);
  hello->mutable_dataset_port()->set_ipc(context_.options().dataset_port.ipc);
  Reply(from, std::move(reply));
}

Result<uint32_t> Gateway::FindOrAllocate(const std::string& token, const pb::OpenRequest& open,
                                         const std::string& compiled_model) {
  const std::string as_sent = open.SerializeAsString();
  const uint64_t hash = XXH3_64bits(as_sent.data(), as_sent.size());
  if (const std::optional<uint32_t> index = table_.Find(token)) {
    if (context_.shared().session(*index).request_hash == hash) return *index;
    return Status(StatusCode::kInvalidArgument,
                  "session_token belongs to a session with other contents, allowed: a new token");
  }
  pb::OpenRequest complete = open;
  complete.set_compiled_model(compiled_model);
  B4MRL_RETURN_IF_ERROR(CompleteOpen(token, &complete));
  const std::string bytes = complete.SerializeAsString();
  return table_.Allocate({token, bytes, hash, complete.num_envs()});
}

void Gateway::HandleOpen(const Envelope& from, pb::Request* request) {
  if (context_.draining()) {
    return Reply(from, Status(StatusCode::kUnavailable, "the daemon is stopping"));
  }
  request->mutable_open()->clear_compiled_model();  // the gateway's own to set
  const std::string& token = request->session_token();
  const std::string file = ModelFileOf(request->open());
  if (!file.empty() && !table_.Find(token)) return CompileModel(from, *request, file);
  StartOpen(from, token, request->open(), "", DeadlineOf(*request));
}

void Gateway::CompileModel(const Envelope& from, const pb::Request& request,
                           const std::string& file) {
  const Deadline deadline = DeadlineOf(request);
  const auto done = [this, from, deadline, token = request.session_token(),
                     open = request.open()](const Result<std::string>& compiled) {
    if (!compiled.ok()) return Reply(from, compiled.status());
    StartOpen(from, token, open, *compiled, deadline);
  };
  const Status status = models_.Compile(request.open().environment(), file, deadline, done);
  if (!status.ok()) Reply(from, status);
}

void Gateway::StartOpen(const Envelope& from, const std::string& token,
                        const pb::OpenRequest& request, const std::string& compiled_model,
                        const Deadline& deadline) {
  const Result<uint32_t> index = FindOrAllocate(token, request, compiled_model);
  if (!index.ok()) return Reply(from, index.status());
  SessionRecord& record = context_.shared().session(*index);
  record.last_activity_ms.store(MonotonicMs());
  if (record.worker >= links_.size()) {
    return Reply(from, Status(StatusCode::kSessionLost, "the session's record is damaged"));
  }
  const uint64_t id = next_attach_id_++;
  const PendingOpen& open = opens_[id] = {.sender = from.sender,
                                          .request_id = from.request_id,
                                          .session_index = *index,
                                          .generation = record.generation,
                                          .worker = record.worker,
                                          .deadline = deadline};
  SendAttach(id, open);
}

void Gateway::SendAttach(uint64_t id, const PendingOpen& open) {
  pb::Request request;
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_request_id(id);
  *request.mutable_session_token() = SessionToken(context_.shared().session(open.session_index));
  request.mutable_attach()->set_session_index(open.session_index);
  request.mutable_attach()->set_generation(open.generation);
  Result<Frame> envelope = SerializeEnvelope(request);
  // A full queue is a worker that does not read; for its replacement RepeatAttaches sends again.
  if (envelope.ok()) (void)links_[open.worker].socket.Send({std::move(*envelope), Frame()});
}

void Gateway::ReadWorker(uint32_t worker) {
  WorkerLink& link = links_[worker];
  while (std::optional<Message> message = link.socket.TryReceive()) {
    pb::Reply attach;
    if (ParseEnvelope(message->envelope, &attach).ok()) FinishOpen(attach.request_id(), attach);
  }
  const uint32_t connections = link.socket.connections();
  if (connections != link.connections) {
    const bool first = link.connections == 0;
    link.connections = connections;
    // What the first connection had to wait for is still queued.
    if (!first) RepeatAttaches(worker);
  }
}

void Gateway::FinishOpen(uint64_t id, const pb::Reply& attach) {
  const auto found = opens_.find(id);
  if (found == opens_.end()) return;
  const PendingOpen open = std::move(found->second);
  opens_.erase(found);
  const Envelope to{open.sender, open.request_id};
  SessionRecord& record = context_.shared().session(open.session_index);
  if (const Status status = GetStatus(attach.status()); !status.ok()) {
    FreeUnopened(open);
    return Reply(to, status);
  }
  if (record.generation != open.generation || !table_.MakeLive(open.session_index)) {
    return Reply(to, Status(StatusCode::kSessionLost, "the session was closed meanwhile"));
  }
  pb::OpenRequest request;
  if (!CheckSessionRecord(record).ok() ||
      !request.ParseFromString(std::string(SessionOpenBytes(record)))) {
    return Reply(to, Status(StatusCode::kSessionLost, "the session's record is damaged"));
  }
  pb::Reply reply;
  pb::OpenReply* out = reply.mutable_open();
  DescribeOpen(request, attach.attach(), out);
  const ChildOptions::Port& port = context_.options().worker_ports[open.worker];
  out->mutable_port()->set_tcp(port.tcp);
  out->mutable_port()->set_ipc(port.ipc);
  Reply(to, std::move(reply));
}

void Gateway::FreeUnopened(const PendingOpen& open) {
  const SessionRecord& record = context_.shared().session(open.session_index);
  if (record.generation == open.generation && record.state() == SessionState::kOpening) {
    table_.Free(open.session_index);
  }
}

void Gateway::RepeatAttaches(uint32_t worker) {
  for (auto it = opens_.begin(); it != opens_.end();) {
    PendingOpen& open = it->second;
    if (open.worker != worker) {
      ++it;
    } else if (open.attempts++ < kMaxAttachAttempts) {
      SendAttach(it->first, open);
      ++it;
    } else {
      FreeUnopened(open);
      Reply({open.sender, open.request_id},
            Status(StatusCode::kInternal, "opening this session ended its worker twice"));
      it = opens_.erase(it);
    }
  }
}

void Gateway::DropExpiredOpens() {
  for (auto it = opens_.begin(); it != opens_.end();) {
    if (!it->second.deadline.expired()) {
      ++it;
      continue;
    }
    // The record stays: the worker may still acknowledge, and the client may ask again.
    Reply({it->second.sender, it->second.request_id},
          Status(StatusCode::kDeadlineExceeded, "the worker did not acknowledge in time"));
    it = opens_.erase(it);
  }
}

void Gateway::Wait() {
  std::vector<void*> sockets = {socket_.handle()};
  for (const WorkerLink& link : links_) sockets.push_back(link.socket.handle());
  relay_.AppendSockets(&sockets);
  // Reconnections of workers show on no socket here, so look for them often while somebody waits.
  constexpr int64_t kWatchfulMs = 5;
  const bool somebody_waits =
      !opens_.empty() || relay_.in_flight() > 0 || !models_.idle() || context_.draining();
  WaitAnyReadable(sockets, somebody_waits ? kWatchfulMs : kBeatIntervalMs);
}

bool Gateway::MayLeave() {
  if (!opens_.empty() || !models_.idle()) return false;
  for (uint32_t child = 0; child < kFirstWorkerChild + links_.size(); ++child) {
    if (child != kGatewayChild && context_.shared().child(child).process_id != 0) return false;
  }
  if (relay_.in_flight() == 0) return true;
  if (!last_words_) last_words_ = Deadline::AfterMs(kLastWordsMs);
  return last_words_->expired();
}

void Gateway::Run() {
  constexpr int kReceiveBurst = 64;
  int64_t next_reap_ms = 0;
  while (!context_.draining() || !MayLeave()) {
    for (int i = 0; i < kReceiveBurst; ++i) {
      std::optional<IncomingMessage> incoming = socket_.TryReceive();
      if (!incoming) break;
      Handle(std::move(*incoming));
    }
    for (uint32_t worker = 0; worker < links_.size(); ++worker) ReadWorker(worker);
    relay_.Pump();
    models_.RunCompletions();
    DropExpiredOpens();
    if (const int64_t now = MonotonicMs(); now >= next_reap_ms) {
      table_.Reap(kAbandonedMs);
      status_.Sample();
      next_reap_ms = now + kReapIntervalMs;
    }
    context_.Beat();
    Wait();
  }
  socket_.LingerOnClose(kFlushMs);
}

}  // namespace

Status RunGateway(ChildContext& context) {
  Context sockets;
  B4MRL_ASSIGN_OR_RETURN(RouterSocket socket,
                         RouterSocket::Bind(sockets, context.options().endpoints));
  std::vector<WorkerLink> links;
  for (const std::string& address : context.options().worker_addresses) {
    B4MRL_ASSIGN_OR_RETURN(DealerSocket dealer, DealerSocket::Connect(sockets, address));
    links.push_back({std::move(dealer)});
  }
  Gateway gateway(context, sockets, std::move(socket), std::move(links));
  gateway.Run();
  return Status();
}

}  // namespace b4mrl
