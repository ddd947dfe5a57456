#include "data/files/atomic_folder.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("a folder appears with all its files when it is committed, and leaves nothing else") {
  const TemporaryFolder parent;
  {
    auto folder = AtomicFolder::Create(parent.File("x-v0"));
    REQUIRE(folder.ok());
    WriteBytes(folder->temporary_path() + "/a", "1");
    CHECK_FALSE(fs::exists(parent.File("x-v0")));
    REQUIRE(folder->Commit().ok());
  }
  CHECK(ReadBytes(parent.File("x-v0/a")) == "1");
  CHECK(std::distance(fs::directory_iterator(parent.path()), fs::directory_iterator()) == 1);
}

TEST_CASE("a folder that is not committed leaves nothing behind") {
  const TemporaryFolder parent;
  {
    auto folder = AtomicFolder::Create(parent.File("x-v0"));
    REQUIRE(folder.ok());
    fs::create_directory(folder->temporary_path() + "/data");
    WriteBytes(folder->temporary_path() + "/data/a", "1");
  }
  CHECK(fs::is_empty(parent.path()));
}

TEST_CASE("a folder that exists is refused and unchanged, also one that appeared meanwhile") {
  const TemporaryFolder parent;
  auto folder = AtomicFolder::Create(parent.File("x-v0"));
  REQUIRE(folder.ok());
  fs::create_directory(parent.File("x-v0"));
  CHECK(folder->Commit().code() == StatusCode::kFailedPrecondition);
  CHECK(fs::is_empty(parent.File("x-v0")));
  CHECK(AtomicFolder::Create(parent.File("x-v0")).status().code() ==
        StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace b4mrl
