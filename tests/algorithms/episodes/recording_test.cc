// Datasets that are recorded here have equal bytes however the work is divided.
#include <catch2/catch.hpp>

#include "tests/algorithms/test_daemon.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

TEST_CASE("A recording has equal bytes for any number of lanes, workers and threads") {
  constexpr uint64_t kRows = 2500, kSeed = 3;
  TestDaemon small({"--workers", "1", "--threads", "1"});
  TestDaemon large({"--workers", "2", "--threads", "4"});
  const std::string bytes = ReadBytes(small.MakeDataset("one", kRows, kSeed, /*lanes_max=*/1));
  CHECK(ReadBytes(large.MakeDataset("many", kRows, kSeed, /*lanes_max=*/64)) == bytes);
  CHECK(ReadBytes(large.MakeDataset("other", kRows, kSeed + 1, /*lanes_max=*/64)) != bytes);
}

}  // namespace b4mrl
