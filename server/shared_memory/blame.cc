#include "server/shared_memory/blame.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

constexpr std::array<int, 5> kDeadlySignals = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
// The handler itself needs little; the kernel's frame with all vector registers takes up to 11 KiB.
constexpr size_t kSignalStackBytes = 64 * 1024;
std::array<struct sigaction, kDeadlySignals.size()> previous_actions;
thread_local ThreadMark* thread_mark = nullptr;
std::atomic<uint32_t>* unmarked_crash = nullptr;

// Async-signal-safe: stores to shared memory and a system call.
void RecordCrash(int signal) {
  (thread_mark != nullptr ? thread_mark->guilty : *unmarked_crash).store(1);
  for (size_t i = 0; i < kDeadlySignals.size(); ++i) {
    // Returning repeats the faulting instruction (abort() raises again) under the previous action.
    if (kDeadlySignals[i] == signal) sigaction(signal, &previous_actions[i], nullptr);
  }
}

void AddRequestBlame(SessionRecord& record, uint64_t request_id, uint32_t blame) {
  RequestBlame* entry = nullptr;
  for (RequestBlame& candidate : record.request_blames) {
    const bool is_its_own = candidate.blame != 0 && candidate.request_id == request_id;
    if (is_its_own || entry == nullptr || candidate.blame < entry->blame) entry = &candidate;
    if (is_its_own) break;
  }
  const bool is_new = entry->blame == 0 || entry->request_id != request_id;
  entry->request_id.store(request_id);
  entry->blame.store(std::min((is_new ? 0 : entry->blame.load()) + blame, kBlameLimit));
}

// Whether the thread of `mark` is blamed for the death. After a crash without a recorded thread, an
// exit, every thread may have caused it. After a freeze the guilty threads are recorded, or there
// are none: the process was stopped, or got no processor.
bool IsAccused(const ThreadMark& mark, Death death, bool some_guilty) {
  if (death == Death::kKilled) return true;
  return mark.guilty != 0 || (death == Death::kCrashed && !some_guilty);
}

}  // namespace

ScopedMark::ScopedMark(ThreadMark* mark, MarkKind kind, uint64_t number) : mark_(mark) {
  mark_->number.store(number, std::memory_order_relaxed);
  mark_->since_ms.store(MonotonicMs(), std::memory_order_relaxed);
  mark_->kind.store(kind, std::memory_order_release);
}

ScopedMark ScopedMark::OfLane(ThreadMark* mark, uint32_t lane, uint64_t number, uint64_t attempt) {
  mark->lane.store(lane, std::memory_order_relaxed);
  mark->attempt.store(attempt, std::memory_order_relaxed);
  return ScopedMark(mark, MarkKind::kLane, number);
}

ScopedMark ScopedMark::OfRequest(ThreadMark* mark, uint32_t session, uint64_t request_id) {
  mark->session.store(session, std::memory_order_relaxed);
  return ScopedMark(mark, MarkKind::kRequest, request_id);
}

ScopedMark ScopedMark::OfSession(ThreadMark* mark, uint32_t session, uint64_t generation) {
  mark->session.store(session, std::memory_order_relaxed);
  return ScopedMark(mark, MarkKind::kSession, generation);
}

MarkedThread::MarkedThread(ThreadMark* mark) : signal_stack_(new std::byte[kSignalStackBytes]) {
  mark->thread_id.store(gettid(), std::memory_order_relaxed);
  thread_mark = mark;
  stack_t stack{};
  stack.ss_sp = signal_stack_.get();
  stack.ss_size = kSignalStackBytes;
  sigaltstack(&stack, nullptr);
}

MarkedThread::~MarkedThread() {
  stack_t none{};
  none.ss_flags = SS_DISABLE;
  sigaltstack(&none, nullptr);
  thread_mark = nullptr;
}

void InstallCrashRecorder(ChildRecord& record) {
  unmarked_crash = &record.unmarked_crash;
  for (size_t i = 0; i < kDeadlySignals.size(); ++i) {
    struct sigaction action {};
    action.sa_handler = RecordCrash;
    action.sa_flags = SA_NODEFER | SA_ONSTACK;
    sigaction(kDeadlySignals[i], &action, &previous_actions[i]);
  }
}

void BlameDeath(SharedState& shared, uint32_t worker, Death death) {
  const std::span<ThreadMark> marks = shared.marks(worker);
  const bool some_guilty =
      std::ranges::any_of(marks, [](const ThreadMark& mark) { return mark.guilty != 0; });
  const uint32_t some_unmarked =
      shared.child(kFirstWorkerChild + worker).unmarked_crash.exchange(0);
  // Nothing that was under way has caused it, unless by a wild pointer.
  if (death == Death::kCrashed && some_unmarked != 0 && !some_guilty) death = Death::kKilled;
  const uint32_t blame = death == Death::kKilled ? kKillBlame : kCrashBlame;
  // By session and request id: a request that many threads execute is blamed once for one death.
  std::set<std::pair<uint32_t, uint64_t>> requests;
  for (ThreadMark& mark : marks) {
    const bool accused = IsAccused(mark, death, some_guilty);
    const MarkKind kind = mark.kind.load();
    const uint32_t lane = mark.lane, session = mark.session;
    if (accused && kind == MarkKind::kLane && lane < limits::kMaxLanes) {
      shared.lane(lane).AddBlame(mark.number.load(), mark.attempt.load(), blame);
    }
    if (accused && kind == MarkKind::kRequest && session < limits::kMaxSessions) {
      requests.emplace(session, mark.number.load());
    }
    if (accused && kind == MarkKind::kSession && session < limits::kMaxSessions &&
        death != Death::kKilled && shared.session(session).generation == mark.number) {
      ++shared.session(session).build_deaths;
    }
    mark.kind.store(MarkKind::kIdle);
    mark.guilty.store(0);
  }
  for (const auto& [session, request_id] : requests) {
    AddRequestBlame(shared.session(session), request_id, blame);
  }
}

uint64_t AttemptKey(Operation operation, std::optional<uint64_t> seed) {
  const auto key = static_cast<uint64_t>(operation);
  return seed ? MixSeeds(key, *seed) : key;
}

bool OperationIsRefused(const LaneSlot& slot, uint64_t attempt) {
  return slot.Blame(attempt) >= kBlameLimit;
}

bool TruncationIsRefused(const LaneSlot& slot, uint64_t attempt) {
  return slot.Blame(attempt) >= 2 * kBlameLimit;
}

bool SessionIsRefused(const SessionRecord& record) {
  return record.build_deaths >= kMaxBuildDeaths;
}

bool RequestIsRefused(const SessionRecord& record, uint64_t request_id) {
  return std::ranges::any_of(record.request_blames, [request_id](const RequestBlame& entry) {
    return entry.blame >= kBlameLimit && entry.request_id == request_id;
  });
}

}  // namespace b4mrl
