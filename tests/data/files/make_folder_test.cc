#include "data/files/make_folder.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("A folder is made with all those around it, and may exist already") {
  const TemporaryFolder scratch;
  const std::string path = scratch.File("a/b/c");
  CHECK(MakeFolder(path).ok());
  CHECK(std::filesystem::is_directory(path));
  CHECK(MakeFolder(path).ok());
}

TEST_CASE("A folder that cannot be made is named in the error") {
  const TemporaryFolder scratch;
  const std::string file = scratch.File("file");
  WriteBytes(file, "text");
  for (const std::string& path : {file, file + "/inside"}) {
    const Status status = MakeFolder(path);
    CHECK(status.code() == StatusCode::kIoError);
    CHECK(status.message().find(path) != std::string::npos);
  }
}

}  // namespace
}  // namespace b4mrl
