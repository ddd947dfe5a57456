#include "data/d4rl/dataset_file_writer.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/example_dataset.h"
#include "tests/data/file_size_limit.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("a written dataset reads back equal, in D4RL's layout") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({5, 9000, 3});
  REQUIRE(WriteExample(folder.File("x.h5"), data).ok());

  auto file = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(file.ok());
  const auto observations = file->OpenColumn("observations");
  REQUIRE(observations.ok());
  CHECK(observations->shape() == std::vector<uint64_t>{9008, 3});
  CHECK(observations->type() == Hdf5Type::kFloat32);
  CHECK(file->ReadFloats("observations").value() == data.observations);
  CHECK(file->ReadFloats("next_observations").value() == data.next_observations);
  CHECK(file->ReadFloats("actions").value() == data.actions);
  CHECK(file->ReadFloats("rewards").value() == data.rewards);
  const auto terminals = file->OpenColumn("terminals");
  REQUIRE(terminals.ok());
  CHECK(terminals->type() == Hdf5Type::kBool);
  CHECK(terminals->shape() == std::vector<uint64_t>{9008});
  std::vector<uint8_t> flags(9008);
  REQUIRE(terminals->ReadFlags(0, flags).ok());
  CHECK(flags == data.terminals);
}

TEST_CASE("equal rows give equal bytes however they are split over appends") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({20000});
  REQUIRE(WriteExample(folder.File("whole.h5"), data).ok());
  DatasetWriterOptions options;
  options.observation_dimensions = data.observation_size;
  options.action_dimensions = data.action_size;
  auto writer = DatasetWriter::Create(folder.File("pieces.h5"), options);
  REQUIRE(writer.ok());
  for (size_t first = 0, step = 1; first < data.rows(); first += step, step = step * 3 % 8191 + 1) {
    step = std::min(step, data.rows() - first);
    REQUIRE(writer->Append(data.Rows(first, step)).ok());
  }
  REQUIRE(writer->Commit().ok());
  CHECK(ReadBytes(folder.File("whole.h5")) == ReadBytes(folder.File("pieces.h5")));
}

TEST_CASE("optional infos and metadata are kept") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({4});
  DatasetWriterOptions options;
  options.observation_dimensions = data.observation_size;
  options.action_dimensions = data.action_size;
  options.qpos_dimensions = 2;
  options.qvel_dimensions = 1;
  options.action_log_probs = true;
  auto writer = DatasetWriter::Create(folder.File("x.h5"), options);
  REQUIRE(writer.ok());
  const std::vector<double> qpos = {1, 2, 3, 4, 5, 6, 7, 1e-300};
  const std::vector<double> qvel = {0.1, 0.2, 0.3, 0.4};
  const std::vector<float> log_probs = {-1, -2, -3, -4};
  DatasetRows rows = data.Rows();
  CHECK(writer->Append(rows).code() == StatusCode::kInvalidArgument);  // infos are missing
  rows.qpos = qpos;
  rows.qvel = qvel;
  rows.action_log_probs = log_probs;
  REQUIRE(writer->Append(rows).ok());
  REQUIRE(writer->SetMetadata("environment", "HalfCheetah").ok());
  REQUIRE(writer->SetMetadata("empty", "").ok());
  REQUIRE(writer->SetMetadata("seed", int64_t{-3}).ok());
  REQUIRE(writer->Commit().ok());

  auto file = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(file.ok());
  std::vector<double> read(8);
  REQUIRE(file->OpenColumn("infos/qpos")->Read(0, read).ok());
  CHECK(read == qpos);
  CHECK(file->ReadFloats("infos/action_log_probs").value() == log_probs);
  CHECK(file->ReadString("metadata/environment").value() == "HalfCheetah");
  CHECK(file->ReadString("metadata/empty").value().empty());
  CHECK(file->ReadNumber("metadata/seed").value() == -3);
}

TEST_CASE("nothing appears before Commit, and a dropped writer leaves nothing") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({10});
  {
    DatasetWriterOptions options;
    options.observation_dimensions = data.observation_size;
    options.action_dimensions = data.action_size;
    auto writer = DatasetWriter::Create(folder.File("x.h5"), options);
    REQUIRE(writer.ok());
    REQUIRE(writer->Append(data.Rows()).ok());
    CHECK_FALSE(std::filesystem::exists(folder.File("x.h5")));
    CHECK(DatasetWriter::Create(folder.File("x.h5"), options).status().code() == StatusCode::kBusy);
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("a full disk is an error at every size, leaves the old file and no half file") {
  const TemporaryFolder folder;
  const std::string path = folder.File("x.h5");
  const ExampleDataset small = MakeExampleDataset({10});
  REQUIRE(WriteExample(path, small).ok());
  const std::string before = ReadBytes(path);
  const ExampleDataset large = MakeExampleDataset({30000});
  for (const rlim_t limit : {0, 1, 500, 5000, 50'000, 300'000, 600'000}) {
    CAPTURE(limit);
    Status status;
    {
      const FileSizeLimit full(limit);
      status = WriteExample(path, large);
    }
    CHECK(status.code() == StatusCode::kIoError);
    CHECK(status.message().find("x.h5") != std::string::npos);
    CHECK(ReadBytes(path) == before);
    CHECK_FALSE(std::filesystem::exists(path + ".b4mrl-tmp"));
  }
  CHECK(WriteExample(path, large).ok());
}

TEST_CASE("a missing folder and wrong sizes are named") {
  const TemporaryFolder folder;
  CHECK(WriteExample(folder.File("none/x.h5"), MakeExampleDataset({2})).code() ==
        StatusCode::kIoError);
  DatasetWriterOptions options;
  CHECK(DatasetWriter::Create(folder.File("x.h5"), options).status().code() ==
        StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl
