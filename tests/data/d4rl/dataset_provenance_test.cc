#include "data/d4rl/dataset_provenance.h"

#include <hdf5.h>

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

DatasetProvenance Example() {
  DatasetProvenance provenance;
  provenance.name = "HalfCheetah/medium-expert-v0";
  provenance.environment = "HalfCheetah";
  provenance.simulator = "hidden=9+16";
  provenance.hidden_dimensions = {9, 16};
  provenance.history_length = 3;
  provenance.recipe = "medium, then expert";
  provenance.parts = {{"uniform random actions", "", 0, 1000},
                      {"SAC, iteration 100000", std::string(64, 'a'), UINT64_MAX, 2000}};
  provenance.engine = "MuJoCo 3.3.2";
  provenance.program = "b4mrl 0.1.0";
  provenance.command = "b4mrl dataset make HalfCheetah/medium-expert-v0";
  provenance.license = "CC-BY-4.0";
  return provenance;
}

Status Write(const std::string& path, const DatasetProvenance& provenance) {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file, Hdf5Writer::Create(path));
  B4MRL_RETURN_IF_ERROR(WriteDatasetProvenance(file, provenance));
  return file.Commit();
}

Result<DatasetProvenance> Read(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader file, Hdf5Reader::Open(path));
  return ReadDatasetProvenance(file);
}

// What is read from a file with the one text `path`.
Result<DatasetProvenance> ReadWithText(const std::string& path, const std::string& text) {
  const TemporaryFolder folder;
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file, Hdf5Writer::Create(folder.File("x.h5")));
  B4MRL_RETURN_IF_ERROR(file.WriteString(path, text));
  B4MRL_RETURN_IF_ERROR(file.Commit());
  return Read(folder.File("x.h5"));
}

TEST_CASE("a dataset's provenance reads back as it was written") {
  const TemporaryFolder folder;
  DatasetProvenance provenance = Example();
  REQUIRE(Write(folder.File("two.h5"), provenance).ok());
  CHECK(Read(folder.File("two.h5")).value() == provenance);
  provenance.parts.resize(1);  // of one part whose policy has no hash
  provenance.hidden_dimensions.clear();
  REQUIRE(Write(folder.File("one.h5"), provenance).ok());
  CHECK(Read(folder.File("one.h5")).value() == provenance);
  REQUIRE(Write(folder.File("none.h5"), DatasetProvenance()).ok());
  CHECK(Read(folder.File("none.h5")).value() == DatasetProvenance());
}

TEST_CASE("a file of others says at most its environment and licence") {
  CHECK(ReadWithText("metadata/environment", "Walker2d")->environment == "Walker2d");
  CHECK(ReadWithText("metadata/license", "MIT")->license == "MIT");
  CHECK(ReadWithText("metadata/other", "text").value() == DatasetProvenance());
  CHECK(ReadWithText("metadata/environment", std::string(5000, 'x'))->environment.empty());
}

TEST_CASE("a file's environment is read from text of variable length, which h5py writes") {
  const TemporaryFolder folder;
  auto others = Hdf5Writer::Create(folder.File("x.h5"));
  REQUIRE(others->WriteString("metadata/other", "text").ok());
  REQUIRE(others->Commit().ok());
  const hid_t file = H5Fopen(folder.File("x.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t dataset =
      H5Dcreate2(file, "metadata/environment", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  const char* text = "Walker2d";
  REQUIRE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, &text) >= 0);
  H5Dclose(dataset);
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(file);
  CHECK(Read(folder.File("x.h5"))->environment == "Walker2d");
}

TEST_CASE("entries of a dataset's provenance outside their range are refused") {
  for (const auto& [name, text] : {std::pair{"hidden", "-1"},
                                   {"hidden", "9,9"},
                                   {"hidden", "16,9"},
                                   {"hidden", "9,"},
                                   {"hidden", "4294967296"},
                                   {"rows", "0"},
                                   {"rows", "x"},
                                   {"rows", "1,"},
                                   {"rows", "5"},
                                   {"history", "3"}}) {
    CAPTURE(name, text);
    const auto read = ReadWithText(std::string("metadata/recording/") + name, text);
    CHECK(read.status().code() == StatusCode::kInvalidArgument);
  }
  const std::string many = "1" + std::string(2 * kMaxRecordedParts, ',');
  CHECK_FALSE(ReadWithText("metadata/recording/rows", many).ok());
  CHECK_FALSE(ReadWithText("metadata/recording/command", std::string(5000, 'x')).ok());
}

TEST_CASE("a history that is no whole number of observations is refused, not rounded") {
  const TemporaryFolder folder;
  for (const double history : {1.5, 0.5, std::nan("")}) {
    auto file = Hdf5Writer::Create(folder.File("x.h5"));
    REQUIRE(file->WriteNumber("metadata/recording/history", history).ok());
    REQUIRE(file->Commit().ok());
    const Status status = Read(folder.File("x.h5")).status();
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK_THAT(status.message(), Catch::Contains("history") && Catch::Contains("whole numbers"));
  }
}

TEST_CASE("a dataset's provenance outside its range is not written") {
  const TemporaryFolder folder;
  const auto refused = [&](const DatasetProvenance& provenance) {
    return Write(folder.File("x.h5"), provenance).code() == StatusCode::kInvalidArgument;
  };
  DatasetProvenance provenance = Example();
  provenance.hidden_dimensions = {16, 9};
  CHECK(refused(provenance));
  provenance = Example();
  provenance.history_length = 0;
  CHECK(refused(provenance));
  provenance = Example();
  provenance.parts[0].policy = "a;b";
  CHECK(refused(provenance));
  provenance = Example();
  provenance.parts.resize(kMaxRecordedParts + 1, provenance.parts[0]);
  CHECK(refused(provenance));
  provenance = Example();
  provenance.command.assign(kMaxProvenanceText + 1, 'x');
  CHECK(refused(provenance));
}

}  // namespace
}  // namespace b4mrl
