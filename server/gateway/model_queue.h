// Chooses which of the users' models that Opens wait for is compiled next, so that quick models do
// not wait for slow ones and no connection keeps the others waiting.
//
// Up to limits::kModelCompilers models are compiled at once, one of each connection and one of each
// file; the others wait in the order in which they came. When all compilers are busy, a newcomer
// takes the place of a model that has been compiled for limits::kQuickModelMs or more: of the one
// that began last, which begins again when no newcomer waits. The model that has been compiled for
// longest keeps its place, so that slow models are finished as well.
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

  // Called by Pump with the path of the compiled model or an error.
  using Completion = std::function<void(const Result<std::string>&)>;
  struct Wish {
    uint64_t number = 0;  // chosen by the caller, for Forget
    RoutingId peer;       // the connection that asks
    std::string environment;
    std::string file;
    Completion done;
  };
  // Queues a wish. Errors are returned at once: unknown environments, names that no model file can
  // have, and kLimitExceeded when limits::kMaxPendingModels wishes wait, or kMaxPendingModelsOfPeer
  // wishes of this peer.
  Status Add(Wish wish);
  // Takes a wish back. A compilation that has begun goes on, and its result is kept for later
  // Opens.
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
  // Whether no running compilation is of the same connection or file.
  bool MayStart(const Wish& wish) const;
  // Starts the wishes of `queue` that may start while compilers are free. Returns how many more
  // could start if more compilers were free.
  size_t StartFrom(std::list<Wish>& queue);
  // Ends slow compilations until `count` compilers are free or about to be.
  void MakeRoomFor(size_t count);

  ModelStore store_;
  std::list<Wish> newcomers_;
  std::list<Wish> slow_;                                     // wishes that made room for newcomers
  std::array<Compiler, limits::kModelCompilers> compilers_;  // use the store on their threads
};

}  // namespace b4mrl
