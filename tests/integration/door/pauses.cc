#include "tests/integration/door/pauses.h"

#include <sched.h>
#include <time.h>

#include <cmath>

#include "proto/base/clock.h"
#include "proto/base/rng.h"
#include "proto/wire/door.h"

namespace b4mrl {
namespace {

// How long after a sleep's end its bell may come, on a machine that is busy with other work.
constexpr int kPatienceMs = 2000;
constexpr double kShortestPauseUs = 0.1, kLongestPauseUs = 60;
constexpr double kLongestSpinUs = 5;

SleepCounts* counts = nullptr;
uint64_t pause_one_in = 0;

// Of this thread's end of its door.
thread_local std::optional<Rng> pauses;
thread_local bool is_worker_end = false;
thread_local DoorWords* words = nullptr;
thread_local size_t ring_bytes = 0;

// Whether the ring has what this end says that it waits for.
bool IsWaitOver() {
  const bool worker = is_worker_end;
  const uint32_t reasons = worker ? words->worker_sleeps : words->client_sleeps;
  const uint64_t incoming =
      worker ? words->up_head - words->up_tail : words->down_head - words->down_tail;
  const uint64_t outgoing =
      worker ? words->down_head - words->down_tail : words->up_head - words->up_tail;
  // A peer that has cleared the word has seen it, and has to ring.
  if (reasons == 0) return true;
  return ((reasons & kSleepsForBytes) != 0 && incoming > 0) ||
         ((reasons & kSleepsForSpace) != 0 && outgoing < ring_bytes);
}

// Sleeps by `wait`(milliseconds), and when that reaches its end, looks whether a bell is missing.
template <typename Wait>
int SleepBy(Wait wait, int timeout_ms) {
  if (words == nullptr || timeout_ms == 0) return wait(timeout_ms);
  Pause();
  ++counts->sleeps;
  int ready = wait(timeout_ms);
  if (ready == 0 && IsWaitOver()) {
    ready = wait(kPatienceMs);
    ++(ready == 0 ? counts->lost_bells : counts->late_bells);
  }
  Pause();
  return ready;
}

}  // namespace

void BeginPauses(SleepCounts* into, uint64_t one_in) {
  counts = into;
  pause_one_in = one_in;
}

void BeginEnd(uint64_t seed, bool is_worker) {
  pauses.emplace(seed, "pauses", is_worker ? 1 : 0);
  is_worker_end = is_worker;
}

void Pause() {
  if (pause_one_in == 0 || pauses->Below(pause_one_in) != 0) return;
  ++counts->pauses;
  const double microseconds =
      kShortestPauseUs * std::pow(kLongestPauseUs / kShortestPauseUs, pauses->Uniform());
  if (microseconds > kLongestSpinUs && pauses->Below(2) == 0) {
    // Sleeps, so that the other end has this processor.
    const timespec length{0, static_cast<long>(microseconds * 1000)};
    ppoll(nullptr, 0, &length, nullptr);
    return;
  }
  const Clock::time_point start = Clock::now();
  while (SecondsSince(start) * 1e6 < microseconds) {
  }
}

int PausedPoll(pollfd* fds, nfds_t count, int timeout_ms) {
  return SleepBy([=](int milliseconds) { return poll(fds, count, milliseconds); }, timeout_ms);
}

int PausedEpollWait(int epoll, epoll_event* events, int most, int timeout_ms) {
  return SleepBy([=](int milliseconds) { return epoll_wait(epoll, events, most, milliseconds); },
                 timeout_ms);
}

void PausedAnnounceSleep(std::atomic<uint32_t>* own_sleeps, uint32_t reasons) {
  Pause();
  AnnounceSleep(own_sleeps, reasons);
}

ssize_t PausedSend(int socket, const void* bytes, size_t size, int flags) {
  Pause();
  return send(socket, bytes, size, flags);
}

void* RememberedMmap(void* at, size_t size, int access, int flags, int fd, off_t offset) {
  void* const memory = mmap(at, size, access, flags, fd, offset);
  if (memory == MAP_FAILED) return memory;
  words = static_cast<DoorWords*>(memory);
  ring_bytes = (size - kDoorWordsBytes) / 2;
  return memory;
}

int ForgottenMunmap(void* memory, size_t size) {
  if (memory == words) words = nullptr;
  return munmap(memory, size);
}

}  // namespace b4mrl
