#include "data/columns/column_cache.h"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <cctype>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "data/files/file_hash.h"
#include "tests/data/file_size_limit.h"
#include "tests/data/manifest_schema.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

const std::vector<float> kValues = {1, 2, 3, 4, 5, 6};

Status MakeCache(const std::string& folder) {
  B4MRL_ASSIGN_OR_RETURN(ColumnCacheWriter writer, ColumnCacheWriter::Create(folder));
  B4MRL_ASSIGN_OR_RETURN(const size_t column, writer.AddColumn("observations", DType::kFloat32, 2));
  B4MRL_RETURN_IF_ERROR(writer.Append(column, std::span<const float>(kValues).first(4)));
  B4MRL_RETURN_IF_ERROR(writer.Append(column, std::span<const float>(kValues).subspan(4)));
  writer.SetProperty("behaviour_policy", "a \xff byte that is no UTF-8");
  return writer.Commit();
}

TEST_CASE("a cache maps back what was written") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  const auto cache = ColumnCache::Map(folder.File("c"));
  REQUIRE(cache.ok());
  CHECK((*cache)->Verify([] { return false; }).ok());
  const auto column = (*cache)->Find<float>("observations", 3, 2);
  REQUIRE(column.ok());
  CHECK(std::vector<float>(column->begin(), column->end()) == kValues);
  CHECK((*cache)->Find<float>("observations", 3, 3).status().code() == StatusCode::kDataLoss);
  CHECK((*cache)->Find<double>("observations", 3, 2).status().code() == StatusCode::kDataLoss);
  CHECK((*cache)->Find<float>("actions", 3, 2).status().code() == StatusCode::kDataLoss);
  CHECK((*cache)->bytes() == 24);
}

TEST_CASE("a mapped cache outlives its folder") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  const auto cache = ColumnCache::Map(folder.File("c"));
  REQUIRE(cache.ok());
  RemoveCache(folder.File("c"));
  CHECK_FALSE(std::filesystem::exists(folder.File("c")));
  CHECK((*cache)->Verify([] { return false; }).ok());
}

TEST_CASE("an uncommitted cache leaves nothing, and a second writer of the same one is harmless") {
  const TemporaryFolder folder;
  {
    auto writer = ColumnCacheWriter::Create(folder.File("c"));
    REQUIRE(writer.ok());
    REQUIRE(writer->AddColumn("observations", DType::kFloat32, 2).ok());
  }
  CHECK(std::filesystem::is_empty(folder.path()));
  REQUIRE(MakeCache(folder.File("c")).ok());
  REQUIRE(MakeCache(folder.File("c")).ok());
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("a file of another length is refused when mapped, changed bytes when verified") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  const std::string column = folder.File("c/observations.raw");
  const std::string bytes = ReadBytes(column);
  for (const std::string& other : {bytes.substr(1), bytes + "x"}) {
    WriteBytes(column, other);
    CHECK(ColumnCache::Map(folder.File("c")).status().code() == StatusCode::kDataLoss);
  }
  std::string changed = bytes;
  changed[7] ^= 1;
  WriteBytes(column, changed);
  const auto cache = ColumnCache::Map(folder.File("c"));
  REQUIRE(cache.ok());
  CHECK((*cache)->Verify([] { return false; }).code() == StatusCode::kDataLoss);
}

TEST_CASE("any damage of the manifest is found") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  const std::string path = folder.File("c/manifest.json");
  const std::string whole = ReadBytes(path);
  for (size_t i = 0; i < whole.size(); ++i) {
    CAPTURE(i);
    std::string bytes = whole;
    bytes[i] = static_cast<char>(bytes[i] ^ 4);
    WriteBytes(path, bytes);
    // White space between values means nothing, and only such a change may pass.
    if (ColumnCache::Map(folder.File("c")).ok()) CHECK(std::isspace(whole[i]) != 0);
    WriteBytes(path, whole.substr(0, i));
    // All but the final newline.
    CHECK(ColumnCache::Map(folder.File("c")).ok() == (i + 1 >= whole.size()));
  }
  WriteBytes(path, std::string(500'000, '['));
  CHECK_FALSE(ColumnCache::Map(folder.File("c")).ok());
}

TEST_CASE("a cache of another schema is told from a damaged one") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  const std::string path = folder.File("c/manifest.json");
  ChangeManifestSchema(path, 2);
  CHECK(ColumnCache::Map(folder.File("c")).status().code() == StatusCode::kVersionMismatch);
}

TEST_CASE("what is mapped is not removed as unused") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  auto first = ColumnCache::Map(folder.File("c"));
  auto second = ColumnCache::Map(folder.File("c"));
  REQUIRE(first.ok());
  REQUIRE(second.ok());
  CHECK_FALSE(RemoveUnusedCache(folder.File("c")));
  first->reset();
  CHECK_FALSE(RemoveUnusedCache(folder.File("c")));
  second->reset();
  CHECK(RemoveUnusedCache(folder.File("c")));
  CHECK(std::filesystem::is_empty(folder.path()));
  CHECK(ColumnCache::Map(folder.File("c")).status().code() == StatusCode::kUnknownName);
}

TEST_CASE("a cache that somebody deleted in part is made again") {
  const TemporaryFolder folder;
  REQUIRE(MakeCache(folder.File("c")).ok());
  std::filesystem::remove(folder.File("c/manifest.json"));
  CHECK(ColumnCache::Map(folder.File("c")).status().code() == StatusCode::kUnknownName);
  REQUIRE(MakeCache(folder.File("c")).ok());
  CHECK(ColumnCache::Map(folder.File("c")).ok());
}

TEST_CASE("a cache is as open as the folder that it lies in, whatever the umask") {
  const TemporaryFolder folder;
  const mode_t umask_before = umask(0);
  for (const mode_t mask : {0, 0022, 0077}) {
    for (const mode_t mode : {0700, 0770, 0755}) {
      CAPTURE(mask, mode);
      const std::string parent = folder.File(std::to_string(mask) + "-" + std::to_string(mode));
      REQUIRE(mkdir(parent.c_str(), 0700) == 0);
      REQUIRE(chmod(parent.c_str(), mode) == 0);
      umask(mask);
      CHECK(MakeCache(parent + "/c").ok());
      umask(umask_before);
      const auto mode_of = [&](const std::string& path) {
        struct stat info {};
        REQUIRE(stat(path.c_str(), &info) == 0);
        return info.st_mode & 0777;
      };
      CHECK(mode_of(parent + "/c") == mode);
      CHECK(mode_of(parent + "/c/observations.raw") == (mode & 0666));
      CHECK(mode_of(parent + "/c/manifest.json") == (mode & 0666));
    }
  }
}

TEST_CASE("a full disk while caching is an error that leaves nothing") {
  const TemporaryFolder folder;
  Status status;
  {
    const FileSizeLimit full(10);
    status = MakeCache(folder.File("c"));
  }
  CHECK(status.code() == StatusCode::kIoError);
  CHECK(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace b4mrl
