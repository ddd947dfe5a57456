// The gateway's main loop: answers Hello, Catalogue, ServerStatus, Open and Ledger. Its replacement
// reads all that it needs from shared memory. Steps pass through the gateway only when their client
// reaches no other port (server/gateway/relay.h).
#include <spdlog/spdlog.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "data/suites/suites.h"
#include "server/environments/list.h"
#include "server/gateway/catalogue.h"
#include "server/gateway/describe.h"
#include "server/gateway/openings.h"
#include "server/gateway/relay.h"
#include "server/gateway/status_report.h"
#include "server/process/child.h"
#include "server/process/memory_shares.h"
#include "server/replies/reply.h"
#include "server/replies/request_kinds.h"
#include "server/shared_memory/ledger_table.h"

namespace b4mrl {
namespace {

// Time that the last messages of a child that has ended may take to arrive here.
constexpr int64_t kLastWordsMs = 100;
// Interval at which the gateway looks for processes that have ended (for the drain) or were
// replaced (for the relay); no socket becomes readable at either.
constexpr int64_t kWatchfulMs = 5;
// Limits on the clients' messages that are handled before workers and relays have their turn.
// ZeroMQ hands out the messages of all connections in turn, so one client's flood delays the others
// by one request for each of theirs.
constexpr int kReceiveBurst = 64;
constexpr auto kReceiveBurstTime = std::chrono::milliseconds(1);

std::string ModelsFolder(const ChildOptions& options) {
  return options.models_folder.empty() ? DefaultModelsFolder() : options.models_folder;
}

// The supervisor has read the suites before it started this process; should they have changed into
// ones that cannot be read, everything else is served on.
std::vector<Benchmark> BenchmarksOf(const ChildOptions& options) {
  auto benchmarks = ReadSuites({DefaultSuitesFolder(), options.suites_folder});
  if (benchmarks.ok()) return *std::move(benchmarks);
  spdlog::error("the catalogue has no benchmarks: {}", benchmarks.status().message());
  return {};
}

class Gateway {
 public:
  Gateway(ChildContext& context, const GatewayShares& memory, Context& sockets, RouterSocket socket,
          std::vector<DealerSocket> workers)
      : context_(context),
        socket_(std::move(socket)),
        // A reply is lost when its client is gone; the client asks again when it is back.
        replies_({context.record().requests, context.record().errors},
                 [this](const RoutingId& client, Message reply) {
                   (void)socket_.Send(client, std::move(reply));
                 }),
        data_folder_(context.options().data_folder),
        status_(context.shared(), data_folder_),
        catalogue_(ModelsFolder(context.options()),
                   [options = context.options()] { return BenchmarksOf(options); }),
        openings_(
            context.shared(), std::move(workers),
            {{ModelsFolder(context.options()), context.options().data_folder},
             context.options().worker_ports},
            data_folder_,
            [this](const Asker& to, const Result<pb::Reply>& opened) { ReplyToOpen(to, opened); }),
        relay_(sockets, context.shared(),
               {context.options().worker_addresses, context.options().dataset_address},
               [this](const RoutingId& client, Message reply) {
                 return socket_.Send(client, std::move(reply));
               },
               {.bytes = memory.relayed}) {}

  void Run();

 private:
  void ReceiveBurst();
  void Handle(IncomingMessage incoming);
  void HandleHello(const Asker& from);
  void HandleCatalogue(const Asker& from);
  void HandleStatus(const Asker& from);
  void HandleOpen(const Asker& from);
  void ReplyToOpen(const Asker& to, Result<pb::Reply> opened);
  void HandleLedger(const Asker& from);
  Result<pb::Reply> AnswerLedger();
  // Relays a request that another process answers.
  void HandleForeign(const Asker& from, Message message);
  void Wait();
  // While draining: whether all other children have ended and all their replies were passed on.
  bool MayLeave();

  ChildContext& context_;
  RouterSocket socket_;
  Responder replies_;
  DataFolder data_folder_;
  StatusReport status_;
  Catalogue catalogue_;
  Openings openings_;
  Relay relay_;
  std::optional<Deadline> last_words_;  // kLastWordsMs after all other children have ended
  pb::Request request_;                 // reused by every message
};

void Gateway::Handle(IncomingMessage incoming) {
  struct Handler {
    pb::Request::PayloadCase payload;
    void (Gateway::*handle)(const Asker& from);
  };
  static constexpr Handler kHandlers[] = {
      {pb::Request::kHello, &Gateway::HandleHello},
      {pb::Request::kCatalogue, &Gateway::HandleCatalogue},
      {pb::Request::kServerStatus, &Gateway::HandleStatus},
      {pb::Request::kOpen, &Gateway::HandleOpen},
      {pb::Request::kLedger, &Gateway::HandleLedger},
  };
  static_assert(HandlesAll(Server::kGateway, kHandlers));
  const std::optional<Asker> asker = replies_.Read(incoming, &request_);
  if (!asker) return;
  Asker from = *asker;
  from.is_local = request_.has_open() && CameFromThisMachine(incoming.message);
  const Handler* handler = FindRow(kHandlers, request_.payload_case());
  if (handler != nullptr) return (this->*handler->handle)(from);
  const RequestKind* kind = FindRow(kRequestKinds, request_.payload_case());
  if (kind == nullptr || !kind->from_clients) {
    return replies_.Reply(from, NotAnswered(Server::kGateway));
  }
  HandleForeign(from, std::move(incoming.message));
}

void Gateway::HandleForeign(const Asker& from, Message message) {
  if (context_.draining()) {
    return replies_.Reply(from, Stopping());
  }
  const Status status = relay_.Forward(from.peer, request_, std::move(message));
  if (status.ok()) return;
  if (!request_.has_close() || status.code() != StatusCode::kSessionLost) {
    return replies_.Reply(from, status);
  }
  openings_.Close(request_.session_token());
  pb::Reply closed;  // a session that does not exist counts as closed
  closed.mutable_close();
  replies_.Reply(from, std::move(closed));
}

void Gateway::HandleHello(const Asker& from) {
  pb::Reply reply;
  pb::HelloReply* hello = reply.mutable_hello();
  const auto& ports = context_.options().worker_ports;
  const bool has_doors = !ports.empty() && !ports.front().door.empty();
  DescribeServer(context_.shared().header().lease_ms, has_doors, hello);
  hello->mutable_dataset_port()->set_tcp(context_.options().dataset_port.tcp);
  hello->mutable_dataset_port()->set_ipc(context_.options().dataset_port.ipc);
  replies_.Reply(from, std::move(reply));
}

void Gateway::HandleCatalogue(const Asker& from) {
  pb::Reply reply;
  catalogue_.FillPage(request_.catalogue(), &reply);
  replies_.Reply(from, std::move(reply));
}

void Gateway::HandleStatus(const Asker& from) {
  pb::Reply reply;
  status_.Fill(reply.mutable_server_status());
  replies_.Reply(from, std::move(reply));
}

void Gateway::HandleOpen(const Asker& from) {
  if (context_.draining()) {
    return replies_.Reply(from, Stopping());
  }
  request_.mutable_open()->clear_compiled_model();  // which only the gateway itself may set
  openings_.Open(from, request_);
}

void Gateway::ReplyToOpen(const Asker& to, Result<pb::Reply> opened) {
  // Clients of other machines cannot share memory with a worker.
  if (opened.ok() && !to.is_local) opened->mutable_open()->mutable_port()->clear_door();
  replies_.Reply(to, std::move(opened));
}

void Gateway::HandleLedger(const Asker& from) { replies_.Reply(from, AnswerLedger()); }

Result<pb::Reply> Gateway::AnswerLedger() {
  LedgerTable ledgers(context_.shared());
  uint64_t number = request_.ledger().ledger();
  if (number == 0) {
    B4MRL_ASSIGN_OR_RETURN(number, ledgers.Open());
  }
  B4MRL_ASSIGN_OR_RETURN(const LedgerCounts counts, ledgers.Read(number));
  pb::Reply reply;
  pb::LedgerReply* ledger = reply.mutable_ledger();
  ledger->set_ledger(number);
  ledger->set_steps(counts.steps);
  ledger->set_episodes(counts.episodes);
  ledger->set_query_rows(counts.query_rows);
  ledger->set_dataset_rows(counts.dataset_rows);
  return reply;
}

void Gateway::Wait() {
  std::vector<void*> sockets = {socket_.handle()};
  openings_.AppendSockets(&sockets);
  relay_.AppendSockets(&sockets);
  std::vector<int> descriptors;
  openings_.AppendDescriptors(&descriptors);
  const bool is_watchful = context_.draining() || relay_.in_flight() > 0;
  const int64_t longest_ms = is_watchful ? kWatchfulMs : kBeatIntervalMs;
  WaitAnyReadable(sockets, openings_.wait_ms(longest_ms), descriptors);
}

bool Gateway::MayLeave() {
  for (uint32_t child = 0; child < kMaxChildren; ++child) {
    if (child != kGatewayChild && context_.shared().child(child).process_id != 0) return false;
  }
  if (!last_words_) last_words_ = Deadline::AfterMs(kLastWordsMs);
  return relay_.in_flight() == 0 || last_words_->expired();
}

void Gateway::ReceiveBurst() {
  const Clock::time_point end = Clock::now() + kReceiveBurstTime;
  for (int i = 0; i < kReceiveBurst && Clock::now() < end; ++i) {
    std::optional<IncomingMessage> incoming = socket_.TryReceive();
    if (!incoming) break;
    Handle(std::move(*incoming));
  }
}

void Gateway::Run() {
  int64_t next_reap_ms = 0;
  while (true) {
    if (context_.draining()) {
      // A worker leaves when it has no work, whatever its socket still holds.
      openings_.RefuseAll();
      if (MayLeave()) break;
    }
    ReceiveBurst();
    openings_.Pump();
    relay_.Pump();
    if (const int64_t now = MonotonicMs(); now >= next_reap_ms) {
      openings_.Reap();
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
  const GatewayShares memory = GatewaySharesOf(context.memory_bytes());
  Context sockets;
  B4MRL_ASSIGN_OR_RETURN(RouterSocket socket,
                         RouterSocket::Bind(sockets, context.options().endpoints, memory.unread));
  std::vector<DealerSocket> workers;
  for (const std::string& address : context.options().worker_addresses) {
    B4MRL_ASSIGN_OR_RETURN(DealerSocket worker, DealerSocket::Connect(sockets, address));
    workers.push_back(std::move(worker));
  }
  Gateway gateway(context, memory, sockets, std::move(socket), std::move(workers));
  gateway.Run();
  return Status();
}

}  // namespace b4mrl
