#include "data/files/stored_bytes.h"

#include <fcntl.h>
#include <unistd.h>

#include <catch2/catch.hpp>

#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("holes of a file do not count") {
  const TemporaryFolder folder;
  const std::string path = folder.File("x");
  WriteBytes(path, std::string(100'000, 'x'));
  const UniqueFd fd(open(path.c_str(), O_RDWR));
  REQUIRE(fd.valid());
  const uint64_t stored = StoredBytes(fd.get());
  CHECK(stored >= 100'000);
  CHECK(stored < 200'000);  // a file system may round up to its blocks
  REQUIRE(ftruncate(fd.get(), 1ll << 40) == 0);
  CHECK(StoredBytes(fd.get()) < 200'000);
  REQUIRE(pwrite(fd.get(), "end", 3, (1ll << 40) - 3) == 3);
  CHECK(StoredBytes(fd.get()) > stored);
  CHECK(StoredBytes(fd.get()) < 400'000);
}

TEST_CASE("what is no regular file stores nothing") {
  const TemporaryFolder folder;
  CHECK(StoredBytes(UniqueFd(open(folder.path().c_str(), O_RDONLY)).get()) == 0);
  CHECK(StoredBytes(UniqueFd(open("/dev/zero", O_RDONLY)).get()) == 0);
  CHECK(StoredBytes(-1) == 0);
}

}  // namespace
}  // namespace b4mrl
