// The memory of a local door, and what a client accepts as such.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <catch2/catch.hpp>

#include "proto/base/limits.h"
#include "proto/wire/door.h"

namespace b4mrl {
namespace {

TEST_CASE("A door's memory can be neither shrunk nor grown, and other memory is not accepted") {
  const Result<DoorMemory> memory = DoorMemory::Create(limits::kRingBytes, limits::kRingBytes);
  REQUIRE(memory.ok());
  CHECK(ftruncate(memory->fd(), 4096) != 0);
  CHECK(ftruncate(memory->fd(), 1 << 30) != 0);

  DoorGreeting greeting;
  greeting.up_bytes = greeting.down_bytes = limits::kRingBytes;
  CHECK(DoorMemory::Map(UniqueFd(dup(memory->fd())), greeting).ok());
  SECTION("of another version") { greeting.version = 2; }
  SECTION("of another magic") { greeting.magic = 1; }
  SECTION("of other sizes") { greeting.down_bytes *= 2; }
  SECTION("of sizes that no ring has") { greeting.up_bytes = limits::kRingBytes + 64; }
  CHECK_FALSE(DoorMemory::Map(UniqueFd(dup(memory->fd())), greeting).ok());
}

// Memory of the right size for two rings of kRingBytes, with these seals.
UniqueFd SealedMemory(int seals) {
  UniqueFd fd(memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  REQUIRE(ftruncate(fd.get(), kDoorWordsBytes + 2 * limits::kRingBytes) == 0);
  REQUIRE(fcntl(fd.get(), F_ADD_SEALS, seals) == 0);
  return fd;
}

TEST_CASE("A door's memory is accepted only if nobody can shrink, grow or unseal it") {
  DoorGreeting greeting;
  greeting.up_bytes = greeting.down_bytes = limits::kRingBytes;
  const auto is_accepted = [&](int seals) {
    return DoorMemory::Map(SealedMemory(seals), greeting).ok();
  };
  CHECK(is_accepted(F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL));
  CHECK_FALSE(is_accepted(0));
  CHECK_FALSE(is_accepted(F_SEAL_GROW | F_SEAL_SEAL));
  CHECK_FALSE(is_accepted(F_SEAL_SHRINK | F_SEAL_SEAL));
  CHECK_FALSE(is_accepted(F_SEAL_SHRINK | F_SEAL_GROW));
}

}  // namespace
}  // namespace b4mrl
