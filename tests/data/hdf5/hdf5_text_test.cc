// Variable-length strings, which h5py writes unless told otherwise: read as text, nowhere else.
#include <hdf5.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <utility>

#include "data/hdf5/hdf5_file.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// A file with metadata/<name> = <text>, as h5py's `file["metadata/name"] = "text"` makes it.
void MakeFile(const std::string& path,
              const std::vector<std::pair<std::string, std::string>>& entries) {
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t group = H5Gcreate2(file, "metadata", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const hid_t space = H5Screate(H5S_SCALAR);
  for (const auto& [name, text] : entries) {
    const hid_t dataset =
        H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    const char* pointer = text.c_str();
    REQUIRE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, &pointer) >= 0);
    H5Dclose(dataset);
  }
  H5Sclose(space);
  H5Tclose(type);
  H5Gclose(group);
  H5Fclose(file);
}

Result<std::string> ReadText(const std::string& path, const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader reader, Hdf5Reader::Open(path));
  return reader.ReadText("metadata/" + name);
}

TEST_CASE("variable-length strings are text, but no data") {
  const TemporaryFolder folder;
  const std::string path = folder.File("x.h5");
  const std::string longest(64 * 1024, 'l');
  MakeFile(path, {{"environment", "HalfCheetah"},
                  {"empty", ""},
                  {"umlaut", "Käfer"},
                  {"longest", longest},
                  {"longer", longest + "l"}});
  CHECK(ReadText(path, "environment").value() == "HalfCheetah");
  CHECK(ReadText(path, "empty").value().empty());
  CHECK(ReadText(path, "umlaut").value() == "Käfer");
  CHECK(ReadText(path, "longest").value() == longest);
  CHECK(ReadText(path, "longer").status().code() == StatusCode::kLimitExceeded);
  CHECK(ReadText(path, "missing").status().code() == StatusCode::kUnknownName);
  const auto reader = Hdf5Reader::Open(path);
  CHECK(reader->OpenColumn("metadata/environment").status().code() == StatusCode::kInvalidArgument);
  CHECK(reader->ReadString("metadata/environment").status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("fixed-length strings and numbers read as ever") {
  const TemporaryFolder folder;
  auto writer = Hdf5Writer::Create(folder.File("x.h5"));
  REQUIRE(writer->WriteString("metadata/name", "fixed").ok());
  REQUIRE(writer->WriteInteger("metadata/number", 7).ok());
  REQUIRE(writer->Commit().ok());
  CHECK(ReadText(folder.File("x.h5"), "name").value() == "fixed");
  CHECK(ReadText(folder.File("x.h5"), "number").status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("a heap that claims what it does not have is refused") {
  const TemporaryFolder folder;
  const std::string path = folder.File("x.h5");
  MakeFile(path, {{"a", "first"}, {"b", "second"}});
  const std::string whole = ReadBytes(path);
  const size_t heap = whole.find("GCOL");
  REQUIRE(heap != std::string::npos);
  const size_t object = heap + 16;  // "first": index 1, 5 bytes
  const auto read_with = [&](size_t offset, uint64_t number, size_t bytes) {
    std::string changed = whole;
    std::memcpy(changed.data() + offset, &number, bytes);
    WriteBytes(path, changed);
    return ReadText(path, "a").status().code();
  };
  CHECK(read_with(heap, 0, 1) == StatusCode::kDataLoss);
  CHECK(read_with(heap + 8, 20, 8) == StatusCode::kDataLoss);   // the heap ends early
  CHECK(read_with(object, 9, 2) == StatusCode::kDataLoss);      // not the index
  CHECK(read_with(object, 0, 2) == StatusCode::kDataLoss);      // free space
  CHECK(read_with(object + 8, 4, 8) == StatusCode::kDataLoss);  // shorter than its reference
  CHECK(read_with(object + 8, 1ull << 40, 8) == StatusCode::kDataLoss);
  CHECK(read_with(object + 8, UINT64_MAX, 8) == StatusCode::kDataLoss);
  CHECK(read_with(object + 8, 5, 8) == StatusCode::kOk);
}

TEST_CASE("no byte of a file with variable-length strings can end the reader") {
  const TemporaryFolder folder;
  const std::string path = folder.File("x.h5");
  MakeFile(path, {{"a", "first"}, {"b", "second"}});
  const std::string whole = ReadBytes(path);
  size_t read = 0;
  for (size_t i = 0; i < whole.size(); i += i < 4096 ? 1 : 37) {
    std::string changed = whole;
    changed[i] = static_cast<char>(changed[i] ^ 0x84);
    WriteBytes(path, changed);
    read += ReadText(path, "a").ok() ? 1 : 0;
  }
  CHECK(read > 0);  // most bytes of so small a file are not looked at
}

}  // namespace
}  // namespace b4mrl
