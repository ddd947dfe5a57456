// Pauses of random length inside the doors' sources: at every point at which one side of the
// sleeping protocol (proto/wire/door.h) may be overtaken by the other. Included by the compiler in
// front of door.cc, client_door.cc and server/door, which door_fuzz compiles for itself.
//
//   the waking side    bytes published | fence | look at the word | word cleared | bell
//   the sleeping side  look | word set | fence | second look | sleep | word cleared
//
// It also says whether a bell was lost: whether a sleep reached its end while the ring had what it
// waited for, and no bell came even long after. Thread rule: each end of a door on its own thread
// or in its own process.
#pragma once

// All that the macros below must not touch.
#include <poll.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/socket.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace b4mrl {

// What happened, in memory that both processes share.
struct SleepCounts {
  std::atomic<uint64_t> pauses{0};
  std::atomic<uint64_t> sleeps{0};
  // Sleeps that reached their end before the bell came: its sender was kept from the processor.
  std::atomic<uint64_t> late_bells{0};
  std::atomic<uint64_t> lost_bells{0};
};

// Before any door: one of `one_in` points pauses, 0: none does.
void BeginPauses(SleepCounts* counts, uint64_t one_in);
// Draws the pauses of this thread from `seed`; `is_worker`: which end of the door it is.
void BeginEnd(uint64_t seed, bool is_worker);

void Pause();
int PausedPoll(pollfd* fds, nfds_t count, int timeout_ms);
int PausedEpollWait(int epoll, epoll_event* events, int most, int timeout_ms);
// In place of AnnounceSleep (proto/wire/door.h).
void PausedAnnounceSleep(std::atomic<uint32_t>* own_sleeps, uint32_t reasons);
ssize_t PausedSend(int socket, const void* bytes, size_t size, int flags);
// Remembers the mapping as the memory of this thread's door.
void* RememberedMmap(void* at, size_t size, int access, int flags, int fd, off_t offset);
// Forgets it, so that a sleep behind the door's end does not look into it.
int ForgottenMunmap(void* memory, size_t size);

}  // namespace b4mrl

namespace std {
inline void PausedFence(memory_order order) {
  b4mrl::Pause();
  atomic_thread_fence(order);
  b4mrl::Pause();
}
}  // namespace std

#ifdef B4MRL_PAUSED_SOURCE
#define atomic_thread_fence(order) PausedFence(order)
#define poll(fds, count, timeout_ms) b4mrl::PausedPoll(fds, count, timeout_ms)
#define epoll_wait(epoll, events, most, timeout_ms) \
  b4mrl::PausedEpollWait(epoll, events, most, timeout_ms)
#define send(socket, bytes, size, flags) b4mrl::PausedSend(socket, bytes, size, flags)
#define mmap(at, size, access, flags, fd, offset) \
  b4mrl::RememberedMmap(at, size, access, flags, fd, offset)
#define munmap(memory, size) b4mrl::ForgottenMunmap(memory, size)
#endif
