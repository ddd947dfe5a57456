// A folder that does not answer keeps nobody waiting.
#include "server/gateway/data_folder.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <future>

#include "proto/base/folders.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// Of a folder that answers, on a machine that may be busy: 0 before the first answer.
uint64_t IdentityOf(DataFolder& folder, uint64_t wanted) {
  const Deadline patience = Deadline::AfterMs(30'000);
  while (folder.Identity() != wanted && !patience.expired()) {
  }
  return folder.Identity();
}

TEST_CASE("The identity of the data folder is that of now, also when the folder is made later") {
  const TemporaryFolder temporary;
  DataFolder folder(temporary.File("data"));
  CHECK(folder.path() == temporary.File("data"));
  CHECK(folder.Identity() == 0);
  std::filesystem::create_directory(temporary.File("data"));
  const uint64_t identity = FolderIdentity(temporary.File("data"));
  CHECK(IdentityOf(folder, identity) == identity);
}

TEST_CASE("While the data folder does not answer, its last identity is told at once") {
  const TemporaryFolder temporary;
  DataFolder folder(temporary.path());
  const uint64_t identity = FolderIdentity(temporary.path());
  REQUIRE(IdentityOf(folder, identity) == identity);
  std::promise<void> answer;
  const Deadline patience = Deadline::AfterMs(30'000);
  const auto held = [answered = answer.get_future().share()] { answered.wait(); };
  while (!folder.TryRun(held)) REQUIRE_FALSE(patience.expired());
  CHECK(folder.Identity() == identity);
  const Deadline soon = Deadline::AfterMs(10'000);
  for (int i = 0; i < 10'000; ++i) CHECK(folder.Identity() == identity);  // not 100 ms each
  CHECK_FALSE(soon.expired());
  CHECK_FALSE(folder.TryRun([] {}));
  answer.set_value();
  while (!folder.TryRun([] {})) REQUIRE_FALSE(patience.expired());
}

}  // namespace
}  // namespace b4mrl
