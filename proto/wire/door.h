// The local door: shared memory instead of sockets, between a client and a worker of one machine.
//
// The supervisor listens on an AF_UNIX socket of type SOCK_SEQPACKET for each worker, under a name
// in Linux's abstract namespace, which ends with the daemon and leaves no file. A client connects;
// the worker accepts, checks the peer's user, makes the connection's memory (a memfd that can be
// neither shrunk nor grown) and sends its greeting with the memfd. From then on messages travel
// through two rings in that memory (proto/wire/ring.h), and the socket carries nothing but bells:
// single bytes that wake a sleeping peer, and the end of the connection when a process dies.
//
// A side that is about to sleep says for what it waits in its `sleeps` word, looks once more, and
// sleeps. The peer publishes or takes bytes, then looks at the word, and if it was waited for,
// clears the word and rings. A sequentially consistent fence stands between the two steps of each
// side, so at least one side sees what the other has written.
//
// Thread rule: an object belongs to one thread.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/ring.h"

namespace b4mrl {

// What a sleeping side waits for, in its `sleeps` word; 0: it is awake.
inline constexpr uint32_t kSleepsForBytes = 1;
inline constexpr uint32_t kSleepsForSpace = 2;

// The first page of a door's memory. The rings follow: up (client to worker), then down.
struct DoorWords {
  alignas(64) std::array<std::byte, 64> reserved;
  alignas(64) std::atomic<uint64_t> up_head;
  alignas(64) std::atomic<uint64_t> up_tail;
  alignas(64) std::atomic<uint64_t> down_head;
  alignas(64) std::atomic<uint64_t> down_tail;
  alignas(64) std::atomic<uint32_t> worker_sleeps;
  alignas(64) std::atomic<uint32_t> client_sleeps;
};
static_assert(offsetof(DoorWords, up_head) == 64 && offsetof(DoorWords, down_tail) == 256 &&
              offsetof(DoorWords, worker_sleeps) == 320 &&
              offsetof(DoorWords, client_sleeps) == 384);
static_assert(std::atomic<uint64_t>::is_always_lock_free);
inline constexpr size_t kDoorWordsBytes = 4096;

// The worker's first and only datagram, which carries the memory's descriptor.
struct DoorGreeting {
  static constexpr uint32_t kMagic = 0x44523442;  // "B4RD"
  static constexpr uint32_t kVersion = 1;

  uint32_t magic = kMagic;
  uint32_t version = kVersion;
  uint32_t up_bytes = 0;
  uint32_t down_bytes = 0;
  uint32_t spin_us = 0;  // the longest spin of either side; 0: none
  std::array<uint32_t, 3> zero{};
};
static_assert(sizeof(DoorGreeting) == 32);

// A door's memory, mapped.
class DoorMemory {
 public:
  // Makes and maps new memory. kIoError when the system gives none.
  static Result<DoorMemory> Create(uint32_t up_bytes, uint32_t down_bytes);
  // Maps the memory that a greeting came with, and closes `fd`. kInvalidArgument for a greeting of
  // another version, sizes that no ring has, or memory that the peer could still shrink.
  static Result<DoorMemory> Map(UniqueFd fd, const DoorGreeting& greeting);
  DoorMemory() = default;
  DoorMemory(DoorMemory&& other) noexcept { *this = std::move(other); }
  DoorMemory& operator=(DoorMemory&& other) noexcept;
  ~DoorMemory();

  DoorWords& words() const { return *reinterpret_cast<DoorWords*>(bytes_); }
  Ring up() const;
  Ring down() const;
  // The descriptor of new memory, for the greeting. The memory needs it no more once it was sent.
  int fd() const { return fd_.get(); }
  void CloseFd() { fd_.Reset(); }

 private:
  static Result<DoorMemory> MapFd(int fd, uint32_t up_bytes, uint32_t down_bytes);

  UniqueFd fd_;
  std::byte* bytes_ = nullptr;
  uint32_t up_bytes_ = 0;
  uint32_t down_bytes_ = 0;
};

// The abstract socket address of the door `name`; returns its length. Longer names than an address
// holds are cut, and then nobody listens under them.
socklen_t DoorAddress(std::string_view name, sockaddr_un* address);
// Whether the process at the other end runs as this process's user, or as root.
bool PeerIsTrusted(int socket);

// Wakes the peer if its word says that it sleeps for `reason`. To be called after bytes were
// published (kSleepsForBytes) or taken (kSleepsForSpace).
void WakePeer(int socket, std::atomic<uint32_t>* peer_sleeps, uint32_t reason);
// Says that this side is about to sleep for `reasons`. The caller then looks once more for what it
// waits for, sleeps, and sets the word to 0.
void AnnounceSleep(std::atomic<uint32_t>* own_sleeps, uint32_t reasons);

}  // namespace b4mrl
