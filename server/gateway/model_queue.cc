#include "server/gateway/model_queue.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/environments/list.h"
#include "server/perturbations/list.h"

namespace b4mrl {

ModelQueue::~ModelQueue() {
  for (Compiler& compiler : compilers_) compiler.cancelled = true;
}

Status ModelQueue::Add(Wish wish) {
  B4MRL_RETURN_IF_ERROR(FindEnvironment(wish.environment).status());
  if (!IsModelFileName(wish.file)) {
    return InvalidArgument("model", wish.file, "the name of a file in the models folder");
  }
  B4MRL_RETURN_IF_ERROR(Admit(wish));
  newcomers_.push_back(std::move(wish));
  return Status();
}

Status ModelQueue::Admit(const Wish& wish) const {
  size_t all = 0;
  size_t of_peer = 0;
  const auto count = [&](const Wish& other) {
    ++all;
    of_peer += other.peer == wish.peer;
  };
  std::ranges::for_each(newcomers_, count);
  std::ranges::for_each(slow_, count);
  for (const Compiler& compiler : compilers_) {
    if (compiler.wish) count(*compiler.wish);
  }
  if (of_peer >= limits::kMaxPendingModelsOfPeer) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} models of this connection wait to be compiled, at most {}",
                              of_peer, limits::kMaxPendingModelsOfPeer));
  }
  if (all < limits::kMaxPendingModels) return Status();
  return Status(StatusCode::kLimitExceeded, fmt::format("{} models wait to be compiled, at most {}",
                                                        all, limits::kMaxPendingModels));
}

void ModelQueue::Forget(uint64_t number) {
  const auto is_it = [number](const Wish& wish) { return wish.number == number; };
  newcomers_.remove_if(is_it);
  slow_.remove_if(is_it);
  for (Compiler& compiler : compilers_) {
    if (compiler.wish && is_it(*compiler.wish)) compiler.wish->done = nullptr;
  }
}

void ModelQueue::Pump() {
  for (Compiler& compiler : compilers_) {
    if (compiler.wish) compiler.thread.RunCompletions();
  }
  if (const size_t left = StartFrom(newcomers_); left > 0) {
    MakeRoomFor(left);
  } else {
    StartFrom(slow_);
  }
}

size_t ModelQueue::StartFrom(std::list<Wish>& queue) {
  size_t left = 0;
  for (auto wish = queue.begin(); wish != queue.end();) {
    const auto current = wish++;
    if (!MayStart(*current)) continue;
    const auto idle = std::ranges::find_if(
        compilers_, [](const Compiler& compiler) { return !compiler.wish.has_value(); });
    if (idle == compilers_.end()) {
      ++left;
      continue;
    }
    Start(*idle, std::move(*current));
    queue.erase(current);
  }
  return left;
}

bool ModelQueue::MayStart(const Wish& wish) const {
  return std::ranges::none_of(compilers_, [&](const Compiler& compiler) {
    return compiler.wish &&
           (compiler.wish->peer == wish.peer ||
            (compiler.wish->file == wish.file && compiler.wish->environment == wish.environment));
  });
}

void ModelQueue::MakeRoomFor(size_t count) {
  std::vector<Compiler*> slow;
  size_t ending = 0;
  const Clock::time_point quick = Clock::now() - std::chrono::milliseconds(limits::kQuickModelMs);
  for (Compiler& compiler : compilers_) {
    if (compiler.cancelled) ++ending;
    if (!compiler.cancelled && compiler.since <= quick) slow.push_back(&compiler);
  }
  std::ranges::sort(slow, {}, &Compiler::since);
  for (; ending < count && slow.size() > 1; ++ending, slow.pop_back()) {
    slow.back()->cancelled = true;
  }
}

void ModelQueue::Start(Compiler& compiler, Wish wish) {
  compiler.since = Clock::now();
  compiler.cancelled = false;
  compiler.wish = std::move(wish);
  compiler.thread.Submit([this, &compiler, environment = compiler.wish->environment,
                          file = compiler.wish->file]() -> BackgroundThread::Completion {
    Result<std::string> path = store_.Compile(environment, file, compiler.cancelled);
    return [this, &compiler, path = std::move(path)] { Finish(compiler, path); };
  });
}

void ModelQueue::Finish(Compiler& compiler, const Result<std::string>& path) {
  Wish wish = std::move(*compiler.wish);
  compiler.wish.reset();
  const bool made_room =
      compiler.cancelled.exchange(false) && path.status().code() == StatusCode::kUnavailable;
  if (!wish.done) return;
  if (made_room) {
    slow_.push_back(std::move(wish));
  } else {
    wish.done(path);
  }
}

void ModelQueue::AppendDescriptors(std::vector<int>* fds) const {
  for (const Compiler& compiler : compilers_) {
    if (compiler.wish) fds->push_back(compiler.thread.fd());
  }
}

}  // namespace b4mrl
