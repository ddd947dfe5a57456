// How sessions are opened: an Open is checked, its model compiled if it names a user's model
// (server/gateway/model_store.h), a record allocated, and the record's worker asked to attach
// itself to the record.
//
// Every Open is answered exactly once: with its session, with an error, at its deadline, or, where
// the daemon stops first, with kUnavailable. A second copy of an Open that waits joins the first.
// However many Opens of one token wait, the worker is asked once, and asked again when it was
// replaced. So limits::kMaxSessions bounds the requests to workers, limits::kMaxPendingOpens and
// kMaxPendingOpensOfPeer the Opens. The replacement of a dead gateway reads the records from shared
// memory, and clients send their Opens again.
//
// Thread rule: the gateway's main thread, which calls Pump in every turn of its loop and at once
// when one of the sockets or descriptors is readable, and waits no longer than wait_ms().
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/gateway/data_folder.h"
#include "server/gateway/model_store.h"
#include "server/process/child.h"
#include "server/process/preparation_queue.h"
#include "server/replies/reply.h"
#include "server/shared_memory/session_table.h"

namespace b4mrl {

class Openings {
 public:
  struct Options {
    ModelStore::Options models;
    std::vector<ChildOptions::Port> worker_ports;  // the ports that clients are told
  };
  using ReplyFunction = std::function<void(const Asker& to, const Result<pb::Reply>&)>;

  // `workers` are connections to the environment workers. Replies leave through `reply`. What is
  // passed by reference outlives the openings.
  Openings(SharedState& shared, std::vector<DealerSocket> workers, Options options,
           DataFolder& data_folder, ReplyFunction reply);

  // `request` is an Open.
  void Open(const Asker& from, const pb::Request& request);
  // Ends the Opens of a session that does not exist yet, such as one whose model is compiled: its
  // client does not want it any more.
  void Close(const std::string& token);
  // Ends all Opens: the daemon stops, so their workers and compilers may not answer any more.
  void RefuseAll();
  // Goes on with the Opens for which a worker or compiler has answered, and ends those whose
  // deadline has passed.
  void Pump();
  // About once a second: frees the records of closed sessions, and of openings whose Open no client
  // repeats.
  void Reap();

  // Whether no Open waits.
  bool empty() const { return waiting_.empty(); }
  // Milliseconds until the next deadline, at most `longest_ms`.
  int64_t wait_ms(int64_t longest_ms) const;
  void AppendSockets(std::vector<void*>* sockets) const;
  void AppendDescriptors(std::vector<int>* fds) const { models_.AddDescriptors(fds); }

 private:
  // An Open that waits for its model or, once there is a record, for its worker.
  struct Waiting {
    Asker from;
    std::string token;
    uint64_t contents = 0;    // hash of the Open as it was sent
    Clock::time_point end;    // the deadline
    uint64_t generation = 0;  // of the record; 0 while it has no record
  };
  // The request to a worker to attach itself to a record. It is kept until the worker answers, even
  // when no Open waits any more, so that another Open of that token does not ask a second time; a
  // copy of an Open does.
  struct Attach {
    uint32_t session_index = 0;
    uint32_t worker = 0;
    std::set<uint64_t> waiting{};  // numbers of Opens
    size_t refusals = 0;           // by workers that lack memory for the session
  };
  using Attaches = std::unordered_map<uint64_t, Attach>;
  struct Worker {
    DealerSocket socket;
    uint32_t connections = 0;
  };

  Status Admit(const Asker& from) const;
  // The Open that waits and of which this one is a copy; null if there is none. kInvalidArgument if
  // another Open with its id waits.
  Result<const Waiting*> FindCopied(const Asker& from, const std::string& token,
                                    uint64_t contents) const;
  // For a copy of an Open: a worker drops an answer for which it has no room, as it does those for
  // clients, and only hears of that by being asked again.
  void AskAgain(uint64_t generation);
  uint64_t Enter(const Asker& from, const pb::Request& request, uint64_t contents);
  // The next steps of Open `number`; an error ends the Open.
  Status CompileModel(uint64_t number, const pb::Request& request, const std::string& file);
  Status AskWorker(uint64_t number, const pb::OpenRequest& open, const std::string& compiled_model);
  // The record's index.
  Result<uint32_t> FindOrAllocate(const Waiting& waiting, const pb::OpenRequest& open,
                                  const std::string& compiled_model);
  // False when the worker's queue is full.
  bool Send(uint64_t generation);
  void ReadWorker(uint32_t index);
  void Finish(Attaches::iterator attach, const pb::Reply& answer);
  // Has the next worker asked for a session that is opening; false once all have refused it.
  bool MoveOn(uint64_t generation, Attach* attach);
  Result<pb::Reply> Conclude(uint64_t generation, const Attach& attach, const pb::Reply& answer);
  // A replacement of a session's worker loads its model again, so it must not make room for others.
  void MarkModelsAsUsed();
  // Ends Open `number` with its reply.
  void Leave(uint64_t number, const Result<pb::Reply>& reply);

  SharedState& shared_;
  SessionTable table_;
  std::vector<Worker> workers_;
  std::vector<ChildOptions::Port> worker_ports_;
  DataFolder& data_folder_;
  ReplyFunction reply_;
  std::unordered_map<uint64_t, Waiting> waiting_;  // by number
  uint64_t next_number_ = 1;
  std::unordered_map<RoutingId, std::map<uint64_t, uint64_t>> peers_;  // request ids to numbers
  std::set<std::pair<Clock::time_point, uint64_t>> deadlines_;         // with numbers of Opens
  Attaches attaches_;                                                  // by the record's generation
  std::set<uint64_t> unsent_;                                          // generations of attaches_
  int64_t next_use_ms_ = 0;
  ModelStore store_;
  // The paths of compiled models. At most limits::kModelCompilers are compiled at once, one of each
  // connection. Last: their compilers use the store.
  PreparationQueue<std::string> models_;
};

}  // namespace b4mrl
