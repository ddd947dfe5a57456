// A folder that does not answer keeps nobody waiting.
#include "server/gateway/data_folder.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <future>

#include "proto/base/folders.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("The identity of the data folder is that of now, also when the folder is made later") {
  const TemporaryFolder temporary;
  DataFolder folder(temporary.File("data"));
  CHECK(folder.path() == temporary.File("data"));
  CHECK(folder.Identity() == 0);
  std::filesystem::create_directory(temporary.File("data"));
  CHECK(folder.Identity() == FolderIdentity(temporary.File("data")));
}

TEST_CASE("While the data folder does not answer, its last identity is told at once") {
  const TemporaryFolder temporary;
  DataFolder folder(temporary.path());
  const uint64_t identity = folder.Identity();
  CHECK(identity != 0);
  std::promise<void> answer;
  REQUIRE(folder.TryRun([answered = answer.get_future().share()] { answered.wait(); }));
  CHECK(folder.Identity() == identity);
  const Deadline soon = Deadline::AfterMs(10'000);
  for (int i = 0; i < 10'000; ++i) CHECK(folder.Identity() == identity);  // not 100 ms each
  CHECK_FALSE(soon.expired());
  CHECK_FALSE(folder.TryRun([] {}));
  answer.set_value();
  const Deadline patience = Deadline::AfterMs(30'000);
  bool runs = false;
  while (!runs && !patience.expired()) runs = folder.TryRun([] {});
  CHECK(runs);
}

}  // namespace
}  // namespace b4mrl
