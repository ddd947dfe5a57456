#include "server/datasets/dataset_worker.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/limits.h"
#include "server/batches/batch_reply.h"
#include "server/batches/batch_turns.h"
#include "server/datasets/dataset_replies.h"
#include "server/datasets/dataset_store.h"
#include "server/datasets/parked_requests.h"
#include "server/datasets/served_datasets.h"
#include "server/process/background_thread.h"
#include "server/process/joined_scans.h"
#include "server/process/memory_shares.h"
#include "server/process/preparation_queue.h"
#include "server/replies/pending_request.h"
#include "server/replies/reply.h"
#include "server/replies/request_kinds.h"
#include "server/shared_memory/ledger_table.h"

namespace b4mrl {
namespace {

// The longest time for messages before background work and deadlines have their turn.
constexpr int64_t kTurnMs = 50;
// The longest time for messages before those whose replies are under way have their turn.
constexpr int64_t kMessagesMs = 1;
using Preparations = PreparationQueue<OpenedDataset>;
// How many imports run at once, each in a process, and derivations, each in a thread.
constexpr Preparations::Limits kImports = {.short_places = 3, .long_places = 2};
constexpr Preparations::Limits kDerivations = {.short_places = 2, .long_places = 1};
constexpr int64_t kShortMs = 2000;  // an import or a derivation that takes longer counts as long
// Openings and mappings from the caches take milliseconds, but of a cache that is not mapped yet as
// long as it takes to read it.
constexpr size_t kShortReads = 2, kLongReads = 1, kReadsOfClient = 2;
using DatasetPointer = std::shared_ptr<const Dataset>;
using Loads = PreparationQueue<DatasetPointer>;

// For a request whose deadline passed while its dataset was imported, derived or mapped.
Status TooLate() {
  return Status(StatusCode::kDeadlineExceeded, "the dataset was not ready in time; ask again");
}

class DatasetWorker {
 public:
  DatasetWorker(ChildContext& context, const DatasetWorkerShares& memory,
                const DatasetWorkerOptions& options, RouterSocket socket)
      : context_(context),
        socket_(std::move(socket)),
        replies_({context.record().requests, context.record().errors},
                 [this](const RoutingId& receiver, Message reply) {
                   const Status sent = socket_.Send(receiver, std::move(reply));
                   if (!sent.ok()) spdlog::debug("a reply was dropped: {}", sent.ToString());
                 }),
        ledgers_(context.shared()),
        store_({context.options().data_folder, options.importer_program,
                uint64_t{context.options().cache_mib} << 20}),
        rows_({.alive = [this] { context_.Beat(); },
               .answer = [this](BatchJob job) { Answer(std::move(job)); },
               .refuse = [this](const Asker& from,
                                const Status& status) { replies_.Reply(from, status); }},
              memory.filled) {}

  void Run();

 private:
  void Handle(IncomingMessage incoming);
  void Dispatch(PendingRequest pending);
  void HandleOpen(PendingRequest pending);
  // Opens the dataset of the parked request `id` from the caches. Prepare has it imported or
  // derived where the caches lack it.
  void SubmitOpen(uint64_t id, const DatasetRequest& wanted);
  void Prepare(uint64_t id, const DatasetRequest& wanted, const OpenedDataset& found);
  void SubmitList(PendingRequest pending);
  // Lists the files for these parked requests.
  void Scan(std::vector<uint64_t> ids);
  void SubmitLoad(const std::string& fingerprint, PendingRequest pending);
  // Keeps a request until its completion or its deadline and returns its id; 0 for a copy of a
  // request that waits, and when too many wait already, which is the reply then.
  uint64_t Park(PendingRequest pending);
  std::function<bool()> Waits(uint64_t id) {
    return [this, id] { return parked_.Find(id) != nullptr; };
  }
  void FinishOpen(uint64_t id, const Result<OpenedDataset>& opened);
  void FinishList(uint64_t id, const Result<std::vector<DatasetFileInfo>>& list);
  void FinishLoad(uint64_t id, const std::string& fingerprint,
                  const Result<DatasetPointer>& dataset);
  // Answers a request, the field kPayload of pb::Request, from the dataset whose fingerprint it
  // names; has the dataset mapped first where it is not.
  template <auto kPayload>
  void Serve(PendingRequest pending);
  void Answer(BatchJob job);
  // Handles messages and requests for rows for at most kTurnMs.
  void TakeTurn();
  // Returns whether there were messages.
  bool HandleMessages();
  void ExpireLate();
  void AnswerAll(const Status& status);

  ChildContext& context_;
  RouterSocket socket_;
  Responder replies_;
  LedgerTable ledgers_;
  DatasetStore store_;  // used by background threads; Run only stops it
  ServedDatasets served_;
  ParkedRequests parked_;
  JoinedScans scans_{{.waits = [this](uint64_t id) { return parked_.Find(id) != nullptr; },
                      .scan = [this](std::vector<uint64_t> ids) { Scan(std::move(ids)); }}};
  BatchTurns rows_;
  // Last: their tasks use the members above.
  BackgroundThread listing_;
  Preparations openings_{{kShortReads, kLongReads, kReadsOfClient}, kShortMs};
  Loads loads_{{kShortReads, kLongReads, kReadsOfClient}, kShortMs};
  Preparations imports_{kImports, kShortMs};
  Preparations derivations_{kDerivations, kShortMs};
};

void DatasetWorker::Run() {
  listing_.Submit([this] {
    store_.TidyUp();
    return [] {};
  });
  std::vector<int> wakes;
  while (!context_.draining()) {
    context_.Beat();
    wakes = {listing_.fd()};
    openings_.AddDescriptors(&wakes);
    loads_.AddDescriptors(&wakes);
    imports_.AddDescriptors(&wakes);
    derivations_.AddDescriptors(&wakes);
    void* const socket = socket_.handle();
    WaitAnyReadable({&socket, 1}, rows_.empty() ? kBeatIntervalMs : 0, wakes);
    TakeTurn();
    listing_.RunCompletions();
    openings_.Run();
    loads_.Run();
    imports_.Run();
    derivations_.Run();
    ExpireLate();
    served_.ReleaseIdle();
  }
  store_.Stop();
  AnswerAll(Stopping());
  socket_.LingerOnClose(kFlushMs);
}

void DatasetWorker::TakeTurn() {
  for (const Deadline turn = Deadline::AfterMs(kTurnMs); !turn.expired();) {
    rows_.Turn();
    const bool had_messages = HandleMessages();
    if (!had_messages && rows_.empty()) return;
  }
}

bool DatasetWorker::HandleMessages() {
  bool had_messages = false;
  for (const Deadline slice = Deadline::AfterMs(kMessagesMs); !slice.expired();) {
    std::optional<IncomingMessage> incoming = socket_.TryReceive();
    if (!incoming) break;
    Handle(std::move(*incoming));
    had_messages = true;
  }
  return had_messages;
}

void DatasetWorker::Handle(IncomingMessage incoming) {
  PendingRequest pending;
  pending.received = Clock::now();
  std::optional<Asker> from = replies_.Read(incoming, &pending.request);
  if (!from) return;
  pending.from = std::move(*from);
  // Requests are kept while they wait, and two bytes of an envelope may be a hundred of memory.
  if (const size_t bytes = pending.request.SpaceUsedLong(); bytes > limits::kMaxKeptRequestBytes) {
    return replies_.Reply(pending.from,
                          Status(StatusCode::kInvalidArgument,
                                 fmt::format("the request takes {} bytes once parsed, at most {}",
                                             bytes, limits::kMaxKeptRequestBytes)));
  }
  pending.deadline = DeadlineOf(pending.request);
  Dispatch(std::move(pending));
}

void DatasetWorker::Dispatch(PendingRequest pending) {
  struct Handler {
    pb::Request::PayloadCase payload;
    void (DatasetWorker::*handle)(PendingRequest pending);
  };
  static constexpr Handler kHandlers[] = {
      {pb::Request::kListDatasets, &DatasetWorker::SubmitList},
      {pb::Request::kOpenDataset, &DatasetWorker::HandleOpen},
      {pb::Request::kDatasetStats, &DatasetWorker::Serve<&pb::Request::dataset_stats>},
      {pb::Request::kSample, &DatasetWorker::Serve<&pb::Request::sample>},
      {pb::Request::kRead, &DatasetWorker::Serve<&pb::Request::read>},
  };
  static_assert(HandlesAll(Server::kDatasetWorker, kHandlers));
  const Handler* handler = FindRow(kHandlers, pending.request.payload_case());
  if (handler == nullptr) {
    return replies_.Reply(pending.from, NotAnswered(Server::kDatasetWorker));
  }
  (this->*handler->handle)(std::move(pending));
}

uint64_t DatasetWorker::Park(PendingRequest pending) {
  if (parked_.AbsorbsCopy(&pending)) return 0;
  // A parked request that expires frees its place, but what was begun for it goes on.
  const RoutingId& peer = pending.from.peer;
  size_t backlog = loads_.Backlog();
  size_t backlog_of_peer = loads_.BacklogOf(peer);
  for (const Preparations* queue : {&openings_, &imports_, &derivations_}) {
    backlog += queue->Backlog();
    backlog_of_peer += queue->BacklogOf(peer);
  }
  const Status room = CheckWaiting(
      "requests for datasets",
      {std::max(parked_.size(), backlog), std::max(parked_.SizeOf(peer), backlog_of_peer)},
      {limits::kMaxPendingDatasetRequests, limits::kMaxPendingDatasetRequestsOfPeer});
  if (!room.ok()) {
    replies_.Reply(pending.from, room);
    return 0;
  }
  return parked_.Add(std::move(pending));
}

void DatasetWorker::HandleOpen(PendingRequest pending) {
  const Result<DatasetRequest> wanted = ReadOpen(pending.request.open_dataset());
  if (!wanted.ok()) return replies_.Reply(pending.from, wanted.status());
  const uint64_t id = Park(std::move(pending));
  if (id == 0) return;
  SubmitOpen(id, *wanted);
}

void DatasetWorker::SubmitOpen(uint64_t id, const DatasetRequest& wanted) {
  ParkedRequest* const parked = parked_.Find(id);
  if (parked == nullptr) return;  // it was answered at its deadline
  const auto done = [this, id, wanted](const Result<OpenedDataset>& opened) {
    if (opened.ok()) served_.Add(*opened);
    const bool missing = opened.ok() && opened->dataset == nullptr;
    return missing ? Prepare(id, wanted, *opened) : FinishOpen(id, opened);
  };
  openings_.Submit(
      parked->request.open_dataset().SerializeAsString(), 0,
      [this, wanted](const std::atomic<bool>& cancelled) { return store_.Open(wanted, cancelled); },
      {parked->from.peer, Waits(id), done});
}

void DatasetWorker::Prepare(uint64_t id, const DatasetRequest& wanted, const OpenedDataset& found) {
  ParkedRequest* const parked = parked_.Find(id);
  if (parked == nullptr) return;  // it was answered at its deadline
  const auto done = [this, id, wanted](const Result<OpenedDataset>& made) {
    if (!made.ok()) return FinishOpen(id, made);
    served_.Add(*made);
    SubmitOpen(id, wanted);
  };
  const bool is_import = found.missing == OpenedDataset::Missing::kImport;
  if (is_import && std::exchange(parked->file_was_imported, true)) {
    return FinishOpen(
        id, Status(StatusCode::kUnavailable,
                   fmt::format("{} changed after it was imported; try again", wanted.name)));
  }
  Preparations& queue = is_import ? imports_ : derivations_;
  queue.Submit(is_import ? wanted.name : found.fingerprint, found.source_bytes,
               [this, wanted, is_import](const std::atomic<bool>& cancelled) {
                 return is_import ? store_.Import(wanted.name, cancelled)
                                  : store_.Derive(wanted, cancelled);
               },
               {parked->from.peer, Waits(id), done});
}

void DatasetWorker::FinishOpen(uint64_t id, const Result<OpenedDataset>& opened) {
  const std::optional<ParkedRequest> pending = parked_.Take(id);
  if (!pending) return;
  if (!opened.ok()) return replies_.Reply(pending->from, opened.status());
  pb::Reply reply;
  FillOpened(*opened, reply.mutable_open_dataset());
  replies_.Reply(pending->from, std::move(reply));
}

void DatasetWorker::SubmitList(PendingRequest pending) {
  const uint64_t id = Park(std::move(pending));
  if (id != 0) scans_.Join(id);
}

void DatasetWorker::Scan(std::vector<uint64_t> ids) {
  listing_.Submit([this] { return store_.List(); },
                  [this, ids = std::move(ids)](const auto& list) {
                    for (const uint64_t id : ids) FinishList(id, list);
                    scans_.EndScan();
                  });
}

void DatasetWorker::FinishList(uint64_t id, const Result<std::vector<DatasetFileInfo>>& list) {
  const std::optional<ParkedRequest> pending = parked_.Take(id);
  if (!pending) return;
  if (!list.ok()) return replies_.Reply(pending->from, list.status());
  pb::Reply reply;
  FillList(*list, pending->request.list_datasets().first(), reply.mutable_list_datasets());
  replies_.Reply(pending->from, std::move(reply));
}

void DatasetWorker::SubmitLoad(const std::string& fingerprint, PendingRequest pending) {
  const uint64_t id = Park(std::move(pending));
  if (id == 0) return;
  const auto done = [this, id, fingerprint](const Result<DatasetPointer>& dataset) {
    FinishLoad(id, fingerprint, dataset);
  };
  loads_.Submit(fingerprint, 0,
                [this, fingerprint](const std::atomic<bool>& cancelled) {
                  return store_.Load(fingerprint, cancelled);
                },
                {parked_.Find(id)->from.peer, Waits(id), done});
}

void DatasetWorker::FinishLoad(uint64_t id, const std::string& fingerprint,
                               const Result<DatasetPointer>& dataset) {
  if (dataset.ok()) served_.Add(fingerprint, *dataset);
  std::optional<ParkedRequest> pending = parked_.Take(id);
  if (!pending) return;
  if (!dataset.ok()) return replies_.Reply(pending->from, dataset.status());
  if (pending->deadline.expired()) return replies_.Reply(pending->from, TooLate());
  Dispatch(std::move(*pending));
}

template <auto kPayload>
void DatasetWorker::Serve(PendingRequest pending) {
  const auto& wanted = (pending.request.*kPayload)();
  const DatasetPointer dataset = served_.Find(wanted.fingerprint());
  if (dataset == nullptr) {
    const std::string fingerprint = wanted.fingerprint();
    return SubmitLoad(fingerprint, std::move(pending));
  }
  Result<BatchReply> reply = BatchReply::To(wanted, dataset);
  if (!reply.ok()) return replies_.Reply(pending.from, reply.status());
  rows_.Add({std::move(pending), *std::move(reply)});
}

void DatasetWorker::Answer(BatchJob job) {
  pb::Reply& reply = job.reply.envelope;
  const pb::Request& request = job.pending.request;
  if (const uint64_t ledger =
          request.has_sample() ? request.sample().ledger() : request.read().ledger()) {
    ledgers_.Add(ledger, {.dataset_rows = reply.arrays(0).shape(0)});
  }
  pb::Timing* timing = reply.mutable_timing();
  timing->set_queued_us(
      static_cast<uint32_t>(MicrosecondsBetween(job.pending.received, job.started)));
  timing->set_serialising_us(static_cast<uint32_t>(MicrosecondsBetween(job.started, Clock::now())));
  replies_.Reply(job.pending.from, std::move(reply), std::move(job.reply.payload));
}

void DatasetWorker::ExpireLate() {
  rows_.Expire();
  for (const ParkedRequest& late : parked_.TakeExpired()) replies_.Reply(late.from, TooLate());
}

void DatasetWorker::AnswerAll(const Status& status) {
  for (const ParkedRequest& pending : parked_.TakeAll()) replies_.Reply(pending.from, status);
  rows_.RefuseAll(status);
}

}  // namespace

Status RunDatasetWorker(ChildContext& context, const DatasetWorkerOptions& options) {
  const DatasetWorkerShares memory = DatasetWorkerSharesOf(context.memory_bytes());
  Context sockets;
  B4MRL_ASSIGN_OR_RETURN(RouterSocket socket,
                         RouterSocket::Bind(sockets, context.options().endpoints, memory.unread));
  DatasetWorker(context, memory, options, std::move(socket)).Run();
  return Status();
}

}  // namespace b4mrl
