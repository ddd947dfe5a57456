// Which of the users' models that Opens wait for is compiled next, so that quick ones do not wait
// for slow ones and no connection keeps the others waiting.
//
// Up to limits::kModelCompilers are compiled at once, one of each connection and one of each file,
// the rest in the order in which they came. When all compilers are busy, a newcomer takes the place
// of the one that began last among those that have had limits::kQuickModelMs; that one begins again
// when no newcomer waits. The one that has been compiled for longest stays, so that the slow come
// to an end as well.
//
// Thread rule: the gateway's main thread, which calls Pump in every turn of its loop and at once
// when one of the descriptors is readable. Destruction ends the running compilations.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <list>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/limits.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "server/gateway/model_store.h"
#include "server/process/background_thread.h"

namespace b4mrl {

class ModelQueue {
 public:
  explicit ModelQueue(ModelStore::Options options) : store_(std::move(options)) {}
  ~ModelQueue();

  // Runs in Pump; the path of the compiled model.
  using Completion = std::function<void(const Result<std::string>&)>;
  struct Wish {
    uint64_t number = 0;  // the caller's, for Forget
    RoutingId peer;       // who asks
    std::string environment;
    std::string file;
    Completion done;
  };
  // An error is told at once: unknown environments, names that no file can have, kLimitExceeded
  // when limits::kMaxPendingModels (or kMaxPendingModelsOfPeer of this peer) wait.
  Status Add(Wish wish);
  // Nobody waits for that model any more. What is being compiled already is compiled to its end,
  // for the next one who asks.
  void Forget(uint64_t number);
  void Pump();
  void AppendDescriptors(std::vector<int>* fds) const;

 private:
  struct Compiler {
    BackgroundThread thread;
    std::optional<Wish> wish;  // being compiled
    Clock::time_point since;
    std::atomic<bool> cancelled{false};
  };
  Status Admit(const Wish& wish) const;
  void Start(Compiler& compiler, Wish wish);
  void Finish(Compiler& compiler, const Result<std::string>& path);
  // Whether `wish` may be compiled beside what is.
  bool MayStart(const Wish& wish) const;
  // Starts what can be started of `queue`. Returns how many more could be if compilers were free.
  size_t StartFrom(std::list<Wish>& queue);
  // Ends slow compilations until `count` compilers are free or about to be.
  void MakeRoomFor(size_t count);

  ModelStore store_;
  std::list<Wish> newcomers_;
  std::list<Wish> slow_;                                     // which made room for others
  std::array<Compiler, limits::kModelCompilers> compilers_;  // use the store on their threads
};

}  // namespace b4mrl
