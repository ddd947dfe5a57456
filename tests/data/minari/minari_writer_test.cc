#include "data/minari/minari_writer.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "data/hdf5/hdf5_file.h"
#include "tests/data/example_dataset.h"
#include "tests/data/file_size_limit.h"
#include "tests/data/minari/example_minari.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("an episode of T rows has T + 1 observations and T of everything else") {
  const TemporaryFolder root;
  const ExampleDataset data = MakeExampleDataset({4, 1, 7});
  REQUIRE(WriteMinariExample(root.path(), data).ok());
  auto file = Hdf5Reader::Open(root.File("x-v0/data/main_data.hdf5"));
  REQUIRE(file.ok());
  size_t row = 0;
  for (const auto& [episode, rows] : {std::pair{0, 4}, {1, 1}, {2, 7}}) {
    const std::string at = "episode_" + std::to_string(episode) + "/";
    const auto slice = [&](const std::vector<float>& all, size_t width, size_t count) {
      return std::vector<float>(all.begin() + row * width, all.begin() + (row + count) * width);
    };
    const auto rows_of = static_cast<size_t>(rows);
    std::vector<float> observations = slice(data.observations, 3, rows_of);
    row += rows_of - 1;
    const std::vector<float> last = slice(data.next_observations, 3, 1);
    row -= rows_of - 1;
    observations.insert(observations.end(), last.begin(), last.end());
    CHECK(file->ReadFloats(at + "observations").value() == observations);
    CHECK(file->ReadFloats(at + "actions").value() == slice(data.actions, 2, rows_of));
    CHECK(file->ReadFloats(at + "rewards").value() == slice(data.rewards, 1, rows_of));
    CHECK(file->OpenColumn(at + "terminations")->type() == Hdf5Type::kBool);
    CHECK(file->OpenColumn(at + "actions")->shape() == std::vector<uint64_t>{rows_of, 2});
    CHECK(file->Exists(at + "infos"));
    row += rows_of;
  }
  CHECK_FALSE(file->Exists("episode_3"));
}

TEST_CASE("equal rows give an equal Minari file however they are split over appends") {
  const TemporaryFolder root;
  const ExampleDataset data = MakeExampleDataset({400, 1, 1, 3000});
  for (const size_t step : {1, 7, 401, 3402}) {
    const std::string id = "split/x-v" + std::to_string(step);
    fs::create_directories(root.File("split"));
    REQUIRE(WriteMinariExample(root.path(), data, id, step).ok());
    CHECK(ReadBytes(root.File(id + "/data/main_data.hdf5")) ==
          ReadBytes(root.File("split/x-v1/data/main_data.hdf5")));
  }
  CHECK(ReadBytes(root.File("split/namespace_metadata.json")) == "{}");
}

TEST_CASE("a dataset that is not complete leaves no folder behind") {
  const TemporaryFolder root;
  const ExampleDataset data = MakeExampleDataset({4, 3});
  EpisodeLengths episodes;
  REQUIRE(episodes.Append(data.Rows()).ok());
  {
    auto writer = MinariWriter::Create(root.path(), "x-v0", episodes);
    REQUIRE(writer.ok());
    REQUIRE(writer->Append(data.Rows(0, 5)).ok());
    CHECK(writer->Commit({}).code() == StatusCode::kInvalidArgument);
    CHECK(writer->Append(data.Rows()).code() == StatusCode::kInvalidArgument);  // too many rows
  }
  CHECK(fs::is_empty(root.path()));
  CHECK(MinariWriter::Create(root.path(), "../x-v0", episodes).status().code() ==
        StatusCode::kInvalidArgument);
}

TEST_CASE("a full disk gives an error with the path, and no folder, wherever it happens") {
  const TemporaryFolder root;
  const ExampleDataset data = MakeExampleDataset({400, 1, 1, 3000});
  REQUIRE(WriteMinariExample(root.path(), data).ok());
  const auto whole = fs::file_size(root.File("x-v0/data/main_data.hdf5"));
  for (const auto limit : {whole / 100, whole / 3, whole - 1}) {
    CAPTURE(limit);
    Status status;
    {
      const FileSizeLimit full(limit);
      status = WriteMinariExample(root.path(), data, "y-v0");
    }
    CHECK(status.code() == StatusCode::kIoError);
    CHECK_THAT(status.message(), Catch::Contains("main_data.hdf5"));
    CHECK(std::distance(fs::directory_iterator(root.path()), fs::directory_iterator()) == 1);
  }
}

}  // namespace
}  // namespace b4mrl
