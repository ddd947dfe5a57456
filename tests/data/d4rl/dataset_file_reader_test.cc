#include "data/d4rl/dataset_file_reader.h"

#include <array>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// A file of one row that says which episode of its training run is its first.
void WriteReplay(const std::string& path, double first_episode) {
  Hdf5Writer file = Take(Hdf5Writer::Create(path));
  const std::array<float, 1> number = {0};
  const std::vector<uint64_t> matrix = {1, 1}, vector = {1};
  for (const char* name : {"observations", "actions", "next_observations"}) {
    RequireOk(file.WriteArray(name, number, matrix));
  }
  for (const char* name : {"rewards", "terminals"}) {
    RequireOk(file.WriteArray(name, number, vector));
  }
  RequireOk(file.WriteNumber(std::string("metadata/") + kReplayFirstEpisode, first_episode));
  RequireOk(file.Commit());
}

TEST_CASE("the first episode of a replay is a whole number") {
  const TemporaryFolder folder;
  const std::string path = folder.File("replay.h5");
  for (const double number : {0.0, 3.0, 99'999'999.0}) {
    WriteReplay(path, number);
    CHECK(Take(DatasetFileReader::Open(path)).replay_first_episode() ==
          static_cast<uint64_t>(number));
  }
  for (const double number : {0.5, -1.0, 1e8}) {
    CAPTURE(number);
    WriteReplay(path, number);
    const Status refused = DatasetFileReader::Open(path).status();
    CHECK(refused.code() == StatusCode::kInvalidArgument);
    CHECK_THAT(refused.message(), Catch::Contains("metadata/replay_first_episode"));
  }
}

}  // namespace
}  // namespace b4mrl
