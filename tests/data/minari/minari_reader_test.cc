#include "data/minari/minari_reader.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "data/d4rl/dataset_file_reader.h"
#include "tests/data/example_dataset.h"
#include "tests/data/minari/example_minari.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// Copies the Minari dataset `id` of `root` into `file`.
Status Convert(
    const TemporaryFolder& root, const std::string& id, const std::string& file,
    uint64_t* unfinished,
    const std::function<Status(uint64_t)>& go_on = [](uint64_t) { return Status(); }) {
  B4MRL_ASSIGN_OR_RETURN(const MinariReader reader, MinariReader::Open(root.File(id + "/data")));
  DatasetWriterOptions options;
  options.observation_dimensions = reader.observation_size();
  options.action_dimensions = reader.action_size();
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(file, options));
  B4MRL_RETURN_IF_ERROR(reader.CopyTo(writer, unfinished, go_on));
  return writer.Commit();
}

void CheckRoundTrip(const ExampleDataset& data) {
  const TemporaryFolder root;
  REQUIRE(WriteMinariExample(root.path(), data).ok());
  uint64_t unfinished = 0;
  REQUIRE(Convert(root, "x-v0", root.File("back.h5"), &unfinished).ok());
  REQUIRE(WriteExample(root.File("straight.h5"), data).ok());
  CHECK(ReadBytes(root.File("back.h5")) == ReadBytes(root.File("straight.h5")));
  CHECK(unfinished == 0);
}

// What a hostile or foreign author puts in place of main_data.hdf5.
void MakeData(const std::string& path, const std::function<void(Hdf5Writer&)>& fill) {
  auto file = Hdf5Writer::Create(path);
  REQUIRE(file.ok());
  fill(*file);
  REQUIRE(file->Commit().ok());
}

// An episode of 2 rows, 3 observation and 2 action values, but for the array `changed`.
void MakeEpisode(Hdf5Writer& file, const std::string& changed, Hdf5Type type,
                 const std::vector<uint64_t>& shape) {
  const auto create = [&](const std::string& name, Hdf5Type usual, std::vector<uint64_t> extents) {
    if (name == changed && shape.empty()) return;
    const bool change = name == changed;
    REQUIRE(file.CreateArray("episode_0/" + name, change ? type : usual, change ? shape : extents)
                .ok());
  };
  create("observations", Hdf5Type::kFloat64, {3, 3});
  create("actions", Hdf5Type::kFloat32, {2, 2});
  create("rewards", Hdf5Type::kFloat64, {2});
  create("terminations", Hdf5Type::kBool, {2});
  create("truncations", Hdf5Type::kBool, {2});
}

TEST_CASE("an exported dataset comes back with the same bytes") {
  CheckRoundTrip(MakeExampleDataset({4, 1, 7, 9000, 2}));
}

TEST_CASE("an unfinished last episode comes back unfinished") {
  ExampleDataset data = MakeExampleDataset({4, 7});
  data.terminals.back() = 0;
  CheckRoundTrip(data);
}

TEST_CASE("a dataset's folder and its folder data are found, others are not") {
  const TemporaryFolder root;
  REQUIRE(WriteMinariExample(root.path(), MakeExampleDataset({3})).ok());
  CHECK(FindMinariData(root.File("x-v0")) == root.File("x-v0/data"));
  CHECK(FindMinariData(root.File("x-v0/data")) == root.File("x-v0/data"));
  CHECK_FALSE(FindMinariData(root.path()).has_value());
  CHECK_FALSE(FindMinariData(root.File("nothing")).has_value());
}

TEST_CASE("an episode of others that is unfinished ends by time-out and is counted") {
  const TemporaryFolder root;
  REQUIRE(WriteMinariExample(root.path(), MakeExampleDataset({2})).ok());
  MakeData(root.File("x-v0/data/main_data.hdf5"),
           [](Hdf5Writer& file) { MakeEpisode(file, "", Hdf5Type::kBool, {}); });
  uint64_t unfinished = 0;
  REQUIRE(Convert(root, "x-v0", root.File("back.h5"), &unfinished).ok());
  CHECK(unfinished == 1);
  const auto back = DatasetFileReader::Open(root.File("back.h5"));
  REQUIRE(back.ok());
  CHECK(back->Read(0, 2)->timeouts == std::vector<uint8_t>{0, 1});
}

TEST_CASE("rewards may be whole numbers, as those of CartPole are in some datasets") {
  const TemporaryFolder root;
  REQUIRE(WriteMinariExample(root.path(), MakeExampleDataset({2})).ok());
  MakeData(root.File("x-v0/data/main_data.hdf5"), [](Hdf5Writer& file) {
    MakeEpisode(file, "rewards", Hdf5Type::kInteger, {2});
    const std::vector<uint8_t> rewards = {1, 3};
    REQUIRE(file.WriteRows("episode_0/rewards", 0, std::span(rewards)).ok());
  });
  uint64_t unfinished = 0;
  REQUIRE(Convert(root, "x-v0", root.File("back.h5"), &unfinished).ok());
  const auto back = DatasetFileReader::Open(root.File("back.h5"));
  REQUIRE(back.ok());
  CHECK(back->Read(0, 2)->rewards == std::vector<float>{1, 3});
}

TEST_CASE("a long episode can be interrupted before its end") {
  const TemporaryFolder root;
  constexpr uint64_t kRows = 9000;  // more than one block of rows so wide
  const ExampleDataset data = MakeExampleDataset({kRows}, /*observation_size=*/500);
  REQUIRE(WriteMinariExample(root.path(), data, "x-v0", /*step=*/1000).ok());
  uint64_t unfinished = 0, copied = 0;
  const Status status =
      Convert(root, "x-v0", root.File("back.h5"), &unfinished, [&](uint64_t rows) {
        copied = rows;
        return Status(StatusCode::kUnavailable, "interrupted");
      });
  CHECK(status.code() == StatusCode::kUnavailable);
  CHECK(copied > 0);
  CHECK(copied < kRows);
}

TEST_CASE("arrays of other types, ranks and lengths than the layout's are refused by name") {
  struct Case {
    const char* array;
    Hdf5Type type;
    std::vector<uint64_t> shape;  // empty: the array is missing
  };
  using enum Hdf5Type;
  for (const Case& c : std::vector<Case>{{"observations", kFloat32, {2, 3}},
                                         {"observations", kFloat32, {3, 4}},
                                         {"observations", kInteger, {3, 3}},
                                         {"observations", kFloat32, {9}},
                                         {"observations", kFloat32, {}},
                                         {"actions", kFloat32, {3, 2}},
                                         {"actions", kFloat32, {2, 1}},
                                         {"rewards", kFloat32, {3}},
                                         {"rewards", kBool, {2}},
                                         {"terminations", kFloat32, {2}},
                                         {"terminations", kBool, {1}},
                                         {"truncations", kBool, {}}}) {
    const TemporaryFolder root;
    REQUIRE(WriteMinariExample(root.path(), MakeExampleDataset({2})).ok());
    MakeData(root.File("x-v0/data/main_data.hdf5"),
             [&](Hdf5Writer& file) { MakeEpisode(file, c.array, c.type, c.shape); });
    uint64_t unfinished = 0;
    const Status status = Convert(root, "x-v0", root.File("back.h5"), &unfinished);
    INFO(c.array << " " << c.shape.size() << ": " << status.message());
    CHECK((status.code() == StatusCode::kInvalidArgument ||
           status.code() == StatusCode::kUnknownName));
    // Of an array that sets the lengths, the message may name the array that does not fit it.
    CHECK_THAT(status.message(), Catch::Contains("episode_0/"));
    CHECK_FALSE(std::filesystem::exists(root.File("back.h5")));
  }
}

TEST_CASE("metadata that promise other episodes or steps than the file has are refused") {
  struct Case {
    const char* entry;
    int value;
    StatusCode code;
  };
  for (const Case& c : {Case{"total_episodes", 1, StatusCode::kDataLoss},
                        Case{"total_episodes", 3, StatusCode::kUnknownName},
                        Case{"total_steps", 8, StatusCode::kDataLoss},
                        Case{"total_steps", 10, StatusCode::kDataLoss}}) {
    const TemporaryFolder root;
    REQUIRE(WriteMinariExample(root.path(), MakeExampleDataset({4, 5})).ok());
    const std::string path = root.File("x-v0/data/metadata.json");
    auto metadata = nlohmann::json::parse(ReadBytes(path));
    metadata[c.entry] = c.value;
    WriteBytes(path, metadata.dump());
    uint64_t unfinished = 0;
    const Status status = Convert(root, "x-v0", root.File("back.h5"), &unfinished);
    INFO(c.entry << " " << c.value << ": " << status.message());
    CHECK(status.code() == c.code);
  }
}

}  // namespace
}  // namespace b4mrl
