#include "data/files/folder_listing.h"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

using Paths = std::vector<std::string>;

TEST_CASE("Files of a folder and of those inside it are found by their extension") {
  const TemporaryFolder scratch;
  fs::create_directories(scratch.File("a/b"));
  for (const char* name : {"one.h5", "two.json", "a/b/three.h5"}) {
    WriteBytes(scratch.File(name), "text");
  }
  REQUIRE(mkfifo(scratch.File("pipe.h5").c_str(), 0600) == 0);
  CHECK(Take(FilesIn(scratch.path(), ".h5")) == Paths{scratch.File("one.h5")});
  CHECK(Take(FilesBelow(scratch.path(), ".h5")) ==
        Paths{scratch.File("a/b/three.h5"), scratch.File("one.h5")});
  CHECK(FilesBelow(scratch.File("none"), ".h5").status().code() == StatusCode::kIoError);
}

TEST_CASE("Files behind a link to a folder are found, and a link that leads back ends") {
  const TemporaryFolder scratch, elsewhere;
  WriteBytes(elsewhere.File("agent.h5"), "text");
  fs::create_directory_symlink(elsewhere.path(), scratch.File("runs"));
  fs::create_symlink(scratch.File("nothing"), scratch.File("broken.h5"));
  CHECK(Take(FilesBelow(scratch.path(), ".h5")) == Paths{scratch.File("runs/agent.h5")});
  // Were each way listed, those through ten links to where they are would be ten to the eighth.
  for (int i = 0; i < 10; ++i) {
    fs::create_directory_symlink(scratch.path(), scratch.File("back" + std::to_string(i)));
  }
  const Paths found = Take(FilesBelow(scratch.path(), ".h5"));
  CHECK(found == Paths{scratch.File("runs/agent.h5")});
}

}  // namespace
}  // namespace b4mrl
