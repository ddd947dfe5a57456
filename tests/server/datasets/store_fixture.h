// A data folder with one file, HalfCheetah/medium, and stores on it.
#pragma once

#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "data/columns/column_cache.h"
#include "server/datasets/dataset_store.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

struct StoreFixture {
  TemporaryFolder folder;
  ExampleDataset data = MakeExampleDataset({700, 300}, 17, 6);

  StoreFixture() {
    std::filesystem::create_directory(folder.File("HalfCheetah"));
    REQUIRE(WriteExample(folder.File("HalfCheetah/medium.h5"), data).ok());
  }
  DatasetStore Store(uint64_t max_cache_bytes = 1ull << 30,
                     const std::string& importer = B4MRL_BINARY_DIR "/b4mrl-serve") const {
    return DatasetStore({.data_folder = folder.path(),
                         .importer_program = importer,
                         .max_cache_bytes = max_cache_bytes});
  }
  // Opens it, with whatever it lacks made first.
  static Result<OpenedDataset> OpenMade(DatasetStore& store, const DatasetRequest& request) {
    const std::atomic<bool> cancelled{false};
    while (true) {
      Result<OpenedDataset> opened = store.Open(request);
      if (!opened.ok() || opened->dataset != nullptr) return opened;
      const bool is_import = opened->missing == OpenedDataset::Missing::kImport;
      Result<OpenedDataset> made =
          is_import ? store.Import(request.name, cancelled) : store.Derive(request, cancelled);
      if (!made.ok()) return made;
    }
  }
  Result<OpenedDataset> OpenMade(const std::string& corruptions, uint64_t seed = 0) const {
    DatasetStore store = Store();
    return OpenMade(store, Request(corruptions, seed));
  }
  std::string WriteScript(const std::string& body) const {
    const std::string path = folder.File("program");
    WriteBytes(path, "#!/bin/sh\n" + body);
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    return path;
  }
  static DatasetRequest Request(const std::string& corruptions, uint64_t seed = 0) {
    return {"HalfCheetah/medium", ParseNamedArguments(corruptions).value(), seed,
            TransitionRule::kStored};
  }
  bool HasCache(const std::string& fingerprint) const {
    return std::filesystem::exists(folder.File(".b4mrl-cache/" + fingerprint + "/manifest.json"));
  }
  // On disk, in whole blocks.
  uint64_t CacheBytes(const std::string& fingerprint) const {
    uint64_t bytes = 0;
    for (const auto& entry :
         std::filesystem::directory_iterator(folder.File(".b4mrl-cache/" + fingerprint))) {
      bytes += (entry.file_size() + 4095) / 4096 * 4096;
    }
    return bytes;
  }
  mode_t ModeOf(const std::string& path) const {
    struct stat info {};
    REQUIRE(stat(folder.File(path).c_str(), &info) == 0);
    return info.st_mode & 0777;
  }
  size_t UnfinishedCount() const {
    const std::filesystem::directory_iterator entries(folder.File(".b4mrl-cache"));
    return std::ranges::count_if(entries, [](const auto& entry) {
      return entry.path().filename().string().starts_with(kUnfinishedCachePrefix);
    });
  }
  size_t CacheCount() const {
    size_t count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder.File(".b4mrl-cache"))) {
      count += entry.path().filename().string().size() == 32 ? 1 : 0;
    }
    return count;
  }
};

}  // namespace b4mrl
