#include "tests/integration/door/scribbler.h"

#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstring>

#include "proto/base/rng.h"
#include "proto/wire/door.h"
#include "tests/proto/wire/raw_door.h"

namespace b4mrl {
namespace {

// A position near another one, as a writer's or a reader's may be, or anywhere.
uint64_t Near(uint64_t position, Rng& rng) {
  switch (rng.Below(4)) {
    case 0:
      return rng.NextUint64();
    case 1:
      return position + rng.Below(1000);
    default:
      return position + kRingLine * rng.Below(100);
  }
}

// One breach of the rules, of many.
void Break(const Ring& ring, std::atomic<uint32_t>* sleeps, Rng& rng) {
  switch (rng.Below(6)) {
    case 0:
      *ring.head = Near(*ring.head, rng);
      break;
    case 1:
      *ring.tail = Near(*ring.tail, rng);
      break;
    case 2:
      *sleeps = static_cast<uint32_t>(rng.Below(5));
      break;
    case 3: {  // a message of random bytes, with a prefix as it should be, or not quite
      const uint32_t lengths[4] = {static_cast<uint32_t>(rng.Below(70'000)),
                                   static_cast<uint32_t>(rng.NextUint64() >> rng.Below(64)),
                                   rng.Below(10) == 0 ? 1u : 0u, 0};
      std::memcpy(ring.bytes + *ring.head % ring.size / kRingLine * kRingLine, lengths,
                  sizeof(lengths));
      *ring.head += kRingLine * (1 + rng.Below(200));
      break;
    }
    default:
      for (int i = 0; i < 100; ++i) {
        ring.bytes[rng.Below(ring.size)] = static_cast<std::byte>(rng.Below(256));
      }
  }
}

}  // namespace

bool Scribble(const std::string& door, uint64_t seed) {
  Rng rng(seed, "scribbles");
  const UniqueFd socket = ConnectToDoor(door);
  DoorGreeting greeting;
  UniqueFd fd = socket.valid() ? ReceiveGreeting(socket.get(), &greeting) : UniqueFd();
  if (!fd.valid()) return false;
  const bool is_sealed = ftruncate(fd.get(), static_cast<off_t>(rng.Below(8192))) != 0;
  const UniqueFd passed(dup(fd.get()));
  const Result<DoorMemory> memory = DoorMemory::Map(std::move(fd), greeting);
  if (!memory.ok()) return false;
  for (uint64_t i = rng.Below(30); i > 0; --i) {
    Break(rng.Below(3) == 0 ? memory->down() : memory->up(),
          rng.Below(2) == 0 ? &memory->words().worker_sleeps : &memory->words().client_sleeps, rng);
    const char bells[100] = {};
    for (uint64_t bell = rng.Below(4) == 0 ? rng.Below(300) : 1; bell > 0; --bell) {
      send(socket.get(), bells, 1 + rng.Below(sizeof(bells)), MSG_DONTWAIT | MSG_NOSIGNAL);
    }
    if (rng.Below(10) == 0) {
      SendWithDescriptors(socket.get(), bells, 1, std::array{passed.get()});
    }
  }
  return is_sealed;
}

}  // namespace b4mrl
