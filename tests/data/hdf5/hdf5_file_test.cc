#include "data/hdf5/hdf5_file.h"

#include <hdf5.h>

#include <catch2/catch.hpp>
#include <functional>

#include "proto/base/rng.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// A file made with the library itself, with whatever a hostile author likes.
void MakeFile(const std::string& path, const std::function<void(hid_t)>& fill) {
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  REQUIRE(file >= 0);
  fill(file);
  H5Fclose(file);
}

struct DatasetPlan {
  hid_t type = H5T_IEEE_F32LE;
  std::vector<hsize_t> extents = {4, 3};
  std::vector<hsize_t> chunk = {};
  std::function<void(hid_t)> creation = nullptr;
  bool write = true;
};

void MakeDataset(hid_t file, const char* name, const DatasetPlan& plan) {
  const int rank = static_cast<int>(plan.extents.size());
  const hid_t space = H5Screate_simple(rank, plan.extents.data(), nullptr);
  const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
  if (!plan.chunk.empty()) H5Pset_chunk(list, rank, plan.chunk.data());
  if (plan.creation) plan.creation(list);
  const hid_t dataset = H5Dcreate2(file, name, plan.type, space, H5P_DEFAULT, list, H5P_DEFAULT);
  if (plan.write) {
    const std::vector<float> values(12, 1.0f);
    H5Dwrite(dataset, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  }
  H5Dclose(dataset);
  H5Pclose(list);
  H5Sclose(space);
}

StatusCode CodeOfOpening(const DatasetPlan& plan) {
  const TemporaryFolder folder;
  MakeFile(folder.File("x.h5"), [&](hid_t file) { MakeDataset(file, "observations", plan); });
  const auto reader = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(reader.ok());
  return reader->OpenColumn("observations").status().code();
}

TEST_CASE("float64, integers of both byte orders and scalars are converted") {
  const TemporaryFolder folder;
  MakeFile(folder.File("x.h5"), [](hid_t file) {
    MakeDataset(file, "doubles", {.type = H5T_IEEE_F64BE});
    MakeDataset(file, "integers", {.type = H5T_STD_I32BE});
    MakeDataset(file, "group-less", {.extents = {12}});
  });
  const auto reader = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(reader.ok());
  CHECK(reader->ReadFloats("doubles").value() == std::vector<float>(12, 1.0f));
  CHECK(reader->ReadFloats("integers").value() == std::vector<float>(12, 1.0f));
  std::vector<uint8_t> flags(6);
  CHECK(reader->OpenColumn("integers")->ReadFlags(2, flags).ok());
  CHECK(flags == std::vector<uint8_t>(6, 1));
  CHECK(reader->OpenColumn("doubles")->ReadFlags(0, flags).code() == StatusCode::kInvalidArgument);
}

TEST_CASE("rows outside a dataset and partial rows are refused") {
  const TemporaryFolder folder;
  MakeFile(folder.File("x.h5"), [](hid_t file) { MakeDataset(file, "a", {}); });
  const auto reader = Hdf5Reader::Open(folder.File("x.h5"));
  const auto column = reader->OpenColumn("a");
  REQUIRE(column.ok());
  std::vector<float> row(3);
  CHECK(column->Read(3, row).ok());
  CHECK(column->Read(4, row).code() == StatusCode::kInvalidArgument);
  CHECK(column->Read(UINT64_MAX, row).code() == StatusCode::kInvalidArgument);
  CHECK(column->Read(0, std::span(row).first(2)).code() == StatusCode::kInvalidArgument);
}

TEST_CASE("storage outside the file is refused") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("secret"), std::string(48, 's'));
  const std::string secret = folder.File("secret");
  CHECK(
      CodeOfOpening({.creation = [&](hid_t list) { H5Pset_external(list, secret.c_str(), 0, 48); },
                     .write = false}) == StatusCode::kInvalidArgument);
  CHECK(CodeOfOpening({.creation =
                           [&](hid_t list) {
                             const hsize_t extents[] = {4, 3};
                             const hid_t space = H5Screate_simple(2, extents, nullptr);
                             H5Pset_virtual(list, space, secret.c_str(), "observations", space);
                             H5Sclose(space);
                           },
                       .write = false}) == StatusCode::kInvalidArgument);
}

TEST_CASE("soft and external links are not followed") {
  const TemporaryFolder folder;
  MakeFile(folder.File("target.h5"), [](hid_t file) { MakeDataset(file, "observations", {}); });
  const std::string target = folder.File("target.h5");
  MakeFile(folder.File("x.h5"), [&](hid_t file) {
    MakeDataset(file, "real", {});
    H5Lcreate_soft("/real", file, "observations", H5P_DEFAULT, H5P_DEFAULT);
    H5Lcreate_external(target.c_str(), "/", file, "outside", H5P_DEFAULT, H5P_DEFAULT);
  });
  const auto reader = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(reader.ok());
  CHECK(reader->OpenColumn("real").ok());
  CHECK(reader->OpenColumn("observations").status().code() == StatusCode::kUnknownName);
  CHECK(reader->OpenColumn("outside/observations").status().code() == StatusCode::kUnknownName);
}

TEST_CASE("types that need allocation or interpretation are refused") {
  const hid_t text = H5Tcopy(H5T_C_S1);
  H5Tset_size(text, H5T_VARIABLE);
  CHECK(CodeOfOpening({.type = text, .write = false}) == StatusCode::kInvalidArgument);
  H5Tclose(text);
  const hid_t list = H5Tvlen_create(H5T_IEEE_F32LE);
  CHECK(CodeOfOpening({.type = list, .write = false}) == StatusCode::kInvalidArgument);
  H5Tclose(list);
  CHECK(CodeOfOpening({.type = H5T_STD_REF_OBJ, .write = false}) == StatusCode::kInvalidArgument);
  const hid_t compound = H5Tcreate(H5T_COMPOUND, 4);
  H5Tinsert(compound, "x", 0, H5T_IEEE_F32LE);
  CHECK(CodeOfOpening({.type = compound, .write = false}) == StatusCode::kInvalidArgument);
  H5Tclose(compound);
}

TEST_CASE("declared sizes are capped before anything is allocated") {
  CHECK(CodeOfOpening({.extents = {1ull << 60, 3}, .chunk = {1024, 3}, .write = false}) ==
        StatusCode::kLimitExceeded);
  CHECK(CodeOfOpening({.extents = {100, 1ull << 40}, .chunk = {1, 1024}, .write = false}) ==
        StatusCode::kLimitExceeded);
  CHECK(CodeOfOpening({.extents = {1 << 28, 1}, .chunk = {1 << 27, 1}, .write = false}) ==
        StatusCode::kLimitExceeded);
  // Chunks are limited in bytes: this one has fewer elements than that.
  CHECK(CodeOfOpening({.extents = {90'000'000, 1}, .chunk = {84'000'000, 1}, .write = false}) ==
        StatusCode::kLimitExceeded);
  // Within the limits, but a file of a few KiB cannot hold it.
  CHECK(CodeOfOpening({.extents = {50'000'000, 17}, .chunk = {1024, 17}, .write = false}) ==
        StatusCode::kDataLoss);
  CHECK(CodeOfOpening({.extents = {2, 2, 3}, .write = false}) == StatusCode::kInvalidArgument);
}

TEST_CASE("the chunk of the longest array that may be written is within the reader's limit") {
  // Without values, which would take 320 MiB: past the limit on chunks, the missing bytes are what
  // is wrong.
  constexpr hsize_t kMost = kMaxReadFloats;
  CHECK(CodeOfOpening({.extents = {kMost}, .chunk = {kMost}, .write = false}) ==
        StatusCode::kDataLoss);
  CHECK(CodeOfOpening({.extents = {kMost + 1}, .chunk = {kMost + 1}, .write = false}) ==
        StatusCode::kLimitExceeded);
}

TEST_CASE("holes of a sparse file hold no rows") {
  // The library takes room for 3.4 GB at once, and the file system does not.
  const auto reserve = [](hid_t list) {
    H5Pset_alloc_time(list, H5D_ALLOC_TIME_EARLY);
    H5Pset_fill_time(list, H5D_FILL_TIME_NEVER);
  };
  CHECK(CodeOfOpening({.extents = {50'000'000, 17}, .creation = reserve, .write = false}) ==
        StatusCode::kDataLoss);
  CHECK(CodeOfOpening({.extents = {4, 3}, .creation = reserve}) == StatusCode::kOk);
}

TEST_CASE("filters other than deflate, shuffle and fletcher32 are refused") {
  CHECK(CodeOfOpening({.chunk = {4, 3}, .creation = [](hid_t list) {
                         H5Pset_shuffle(list);
                         H5Pset_deflate(list, 4);
                         H5Pset_fletcher32(list);
                       }}) == StatusCode::kOk);
  CHECK(CodeOfOpening({.chunk = {4, 3}, .creation = [](hid_t list) {
                         H5Pset_scaleoffset(list, H5Z_SO_FLOAT_DSCALE, 2);
                       }}) == StatusCode::kInvalidArgument);
}

TEST_CASE("a flipped bit in the data of a written file is found") {
  const TemporaryFolder folder;
  const ExampleDataset data = MakeExampleDataset({3000});
  REQUIRE(WriteExample(folder.File("x.h5"), data).ok());
  const std::string whole = ReadBytes(folder.File("x.h5"));
  Rng rng(1, "flip");
  int silent = 0;
  for (int i = 0; i < 200; ++i) {
    std::string bytes = whole;
    const size_t at = rng.Below(bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << rng.Below(8)));
    WriteBytes(folder.File("y.h5"), bytes);
    const auto reader = Hdf5Reader::Open(folder.File("y.h5"));
    if (!reader.ok()) continue;
    const auto read = reader->ReadFloats("observations");
    if (read.ok() && *read != data.observations) ++silent;
  }
  // Headers carry no checksums in this format version, but data does: what reads must be right.
  CHECK(silent == 0);
}

TEST_CASE("arrays of known extents read back, and rows outside them are refused") {
  const TemporaryFolder folder;
  auto writer = Hdf5Writer::Create(folder.File("x.h5"));
  REQUIRE(writer.ok());
  REQUIRE(writer->CreateArray("a/b/values", Hdf5Type::kFloat32, std::vector<uint64_t>{4, 2}).ok());
  REQUIRE(writer->CreateArray("a/flags", Hdf5Type::kBool, std::vector<uint64_t>{3}).ok());
  const std::vector<float> late = {5, 6, 7, 8}, early = {1, 2, 3, 4};
  REQUIRE(writer->WriteRows("a/b/values", 2, late).ok());
  REQUIRE(writer->WriteRows("a/b/values", 0, early).ok());
  REQUIRE(writer->WriteRows("a/flags", 1, std::vector<uint8_t>{1}).ok());
  REQUIRE(writer->CreateGroup("a/empty").ok());
  REQUIRE(writer->WriteAttribute("a", "id", -7).ok());
  const auto code = [&](const char* path, uint64_t first, const std::vector<float>& values) {
    return writer->WriteRows(path, first, values).code();
  };
  CHECK(code("a/b/values", 3, late) == StatusCode::kInvalidArgument);
  CHECK(code("a/b/values", ~uint64_t{0}, late) == StatusCode::kInvalidArgument);
  CHECK(code("a/b/values", 0, {1}) == StatusCode::kInvalidArgument);
  CHECK(code("a/nothing", 0, late) == StatusCode::kInternal);
  for (const std::vector<uint64_t>& shape : {std::vector<uint64_t>{}, {0}, {2, 0}, {1, 1, 1}}) {
    CHECK(writer->CreateArray("b", Hdf5Type::kFloat32, shape).code() ==
          StatusCode::kInvalidArgument);
  }
  REQUIRE(writer->Commit().ok());

  const auto reader = Hdf5Reader::Open(folder.File("x.h5"));
  REQUIRE(reader.ok());
  CHECK(reader->ReadFloats("a/b/values").value() == std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8});
  std::vector<uint8_t> flags(3);
  REQUIRE(reader->OpenColumn("a/flags")->ReadFlags(0, flags).ok());
  CHECK(flags == std::vector<uint8_t>{0, 1, 0});
  CHECK(reader->Exists("a/empty"));
  const hid_t file = H5Fopen(folder.File("x.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t attribute = H5Aopen_by_name(file, "a", "id", H5P_DEFAULT, H5P_DEFAULT);
  int64_t id = 0;
  CHECK(H5Aread(attribute, H5T_NATIVE_INT64, &id) >= 0);
  CHECK(id == -7);
  H5Aclose(attribute);
  H5Fclose(file);
}

}  // namespace
}  // namespace b4mrl
