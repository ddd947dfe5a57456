// What counts as a dataset in a data folder.
#include "server/datasets/dataset_files.h"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/limits.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("Regular files and links to them are datasets; folders and pipes are none") {
  const TemporaryFolder folder;
  fs::create_directories(folder.File("Hopper/folder.h5"));
  WriteBytes(folder.File("Hopper/file.h5"), "rows");
  fs::create_symlink("file.h5", folder.File("Hopper/link.h5"));
  fs::create_symlink("nowhere.h5", folder.File("Hopper/dangling.h5"));
  REQUIRE(mkfifo(folder.File("Hopper/pipe.h5").c_str(), 0600) == 0);
  const Result<std::vector<DatasetFile>> files = FindDatasetFiles(folder.path());
  REQUIRE(files.ok());
  std::vector<std::string> names;
  for (const DatasetFile& file : *files) names.push_back(file.name);
  CHECK(names == std::vector<std::string>{"Hopper/file", "Hopper/link"});
  CHECK(FindDatasetFile(folder.path(), "Hopper/pipe").status().code() == StatusCode::kUnknownName);
}

TEST_CASE("A data folder may hold as many datasets as a listing can name, and no more") {
  const TemporaryFolder folder;
  fs::create_directories(folder.File("Hopper"));
  for (size_t i = 0; i < limits::kMaxDatasets; ++i) {
    WriteBytes(folder.File("Hopper/" + std::to_string(i) + ".h5"), "");
  }
  const Result<std::vector<DatasetFile>> most = FindDatasetFiles(folder.path());
  REQUIRE(most.ok());
  CHECK(most->size() == limits::kMaxDatasets);
  WriteBytes(folder.File("Hopper/more.h5"), "");
  const Status refused = FindDatasetFiles(folder.path()).status();
  CHECK(refused.code() == StatusCode::kLimitExceeded);
  CHECK(refused.message() == folder.path() + " has more than 4096 datasets");
}

}  // namespace
}  // namespace b4mrl
