#include "proto/wire/door.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;

bool IsRingSize(uint32_t bytes) {
  return std::has_single_bit(bytes) && bytes >= limits::kMinRingBytes &&
         bytes <= limits::kMaxRingBytes;
}

size_t MemoryBytes(uint32_t up_bytes, uint32_t down_bytes) {
  return kDoorWordsBytes + size_t{up_bytes} + down_bytes;
}

}  // namespace

Result<DoorMemory> DoorMemory::Create(uint32_t up_bytes, uint32_t down_bytes) {
  UniqueFd fd(memfd_create("b4mrl-door", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (!fd.valid() ||
      ftruncate(fd.get(), static_cast<off_t>(MemoryBytes(up_bytes, down_bytes))) != 0 ||
      fcntl(fd.get(), F_ADD_SEALS, kSeals) != 0) {
    return IoError("make", "the memory of a door", errno);
  }
  B4MRL_ASSIGN_OR_RETURN(DoorMemory memory, MapFd(fd.get(), up_bytes, down_bytes));
  memory.fd_ = std::move(fd);
  return memory;
}

Result<DoorMemory> DoorMemory::Map(UniqueFd fd, const DoorGreeting& greeting) {
  if (greeting.magic != DoorGreeting::kMagic || greeting.version != DoorGreeting::kVersion) {
    return InvalidNumber("version of the door", greeting.version,
                         fmt::format("{}", DoorGreeting::kVersion));
  }
  if (!IsRingSize(greeting.up_bytes) || !IsRingSize(greeting.down_bytes)) {
    return InvalidNumber("bytes of the door's ring", greeting.up_bytes, "a ring's size");
  }
  struct stat info {};
  const int seals = fcntl(fd.get(), F_GET_SEALS);
  const size_t bytes = MemoryBytes(greeting.up_bytes, greeting.down_bytes);
  if (seals < 0 || (seals & kSeals) != kSeals || fstat(fd.get(), &info) != 0 ||
      static_cast<size_t>(info.st_size) != bytes) {
    return Status(StatusCode::kInvalidArgument,
                  "the door's memory may shrink, or has another size");
  }
  return MapFd(fd.get(), greeting.up_bytes, greeting.down_bytes);
}

Result<DoorMemory> DoorMemory::MapFd(int fd, uint32_t up_bytes, uint32_t down_bytes) {
  void* const bytes =
      mmap(nullptr, MemoryBytes(up_bytes, down_bytes), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (bytes == MAP_FAILED) return IoError("map", "the memory of a door", errno);
  DoorMemory memory;
  memory.bytes_ = static_cast<std::byte*>(bytes);
  memory.up_bytes_ = up_bytes;
  memory.down_bytes_ = down_bytes;
  return memory;
}

DoorMemory& DoorMemory::operator=(DoorMemory&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(bytes_, other.bytes_);
  std::swap(up_bytes_, other.up_bytes_);
  std::swap(down_bytes_, other.down_bytes_);
  return *this;
}

DoorMemory::~DoorMemory() {
  if (bytes_ != nullptr) munmap(bytes_, MemoryBytes(up_bytes_, down_bytes_));
}

Ring DoorMemory::up() const {
  return {&words().up_head, &words().up_tail, bytes_ + kDoorWordsBytes, up_bytes_};
}

Ring DoorMemory::down() const {
  return {&words().down_head, &words().down_tail, bytes_ + kDoorWordsBytes + up_bytes_,
          down_bytes_};
}

socklen_t DoorAddress(std::string_view name, sockaddr_un* address) {
  *address = {};
  address->sun_family = AF_UNIX;
  // An abstract name begins with a zero byte and is as long as the address says.
  const size_t length = std::min(name.size(), sizeof(address->sun_path) - 1);
  std::memcpy(address->sun_path + 1, name.data(), length);
  return static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + length);
}

bool PeerIsTrusted(int socket) {
  ucred peer{};
  socklen_t size = sizeof(peer);
  if (getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &peer, &size) != 0) return false;
  return peer.uid == geteuid() || peer.uid == 0;
}

void WakePeer(int socket, std::atomic<uint32_t>* peer_sleeps, uint32_t reason) {
  std::atomic_thread_fence(std::memory_order_seq_cst);
  if ((peer_sleeps->load(std::memory_order_relaxed) & reason) == 0) return;
  // Cleared before the bell, so a peer that falls asleep in between is woken by this bell.
  peer_sleeps->store(0, std::memory_order_relaxed);
  const char bell = 0;
  // With a full queue of bells, there are bells enough; a peer that has gone needs none.
  (void)!send(socket, &bell, sizeof(bell), MSG_DONTWAIT | MSG_NOSIGNAL);
}

void AnnounceSleep(std::atomic<uint32_t>* own_sleeps, uint32_t reasons) {
  own_sleeps->store(reasons, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
}

}  // namespace b4mrl
