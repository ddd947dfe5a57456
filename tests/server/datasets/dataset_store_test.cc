#include "server/dataset_store.h"

#include <catch2/catch.hpp>
#include <filesystem>

#include "tests/data/example_dataset.h"
#include "tests/data/file_size_limit.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

struct StoreFixture {
  TemporaryFolder folder;
  ExampleDataset data = MakeExampleDataset({700, 300}, 17, 6);

  StoreFixture() {
    fs::create_directory(folder.File("HalfCheetah"));
    REQUIRE(WriteExample(folder.File("HalfCheetah/medium.h5"), data).ok());
  }
  DatasetStore Store(uint64_t max_cache_bytes = 1ull << 30) const {
    return DatasetStore({.data_folder = folder.path(),
                         .importer_program = std::string(B4MRL_BINARY_DIR) + "/b4mrl-serve",
                         .max_cache_bytes = max_cache_bytes});
  }
  static DatasetRequest Request(const std::string& corruptions, uint64_t seed = 0) {
    return {"HalfCheetah/medium", ParseNamedArguments(corruptions).value(), seed,
            TransitionRule::kStored};
  }
  size_t CacheCount() const {
    size_t count = 0;
    for (const auto& entry : fs::directory_iterator(folder.File(".cache"))) {
      count += entry.path().filename().string().size() == 32 ? 1 : 0;
    }
    return count;
  }
};

TEST_CASE("an unchanged file is imported once, also by another process") {
  const StoreFixture fixture;
  const auto first = fixture.Store().Open(fixture.Request(""));
  REQUIRE(first.ok());
  DatasetStore other({.data_folder = fixture.folder.path(),
                      .importer_program = "/no/such/program",
                      .max_cache_bytes = 1ull << 30});
  const auto second = other.Open(fixture.Request(""));
  REQUIRE(second.ok());
  CHECK(second->fingerprint == first->fingerprint);
  CHECK(second->info.sha256 == first->info.sha256);
  // Written again, it is another file as far as one can see without reading it.
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data).ok());
  CHECK(other.Open(fixture.Request("")).status().code() == StatusCode::kIoError);
  CHECK(fixture.Store().Open(fixture.Request(""))->fingerprint == first->fingerprint);
}

TEST_CASE("equal corruptions share a cache, however they are written") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  const auto preset = store.Open(fixture.Request("obs-noise-low", 1));
  REQUIRE(preset.ok());
  CHECK(store.Open(fixture.Request("obs-noise=0.010", 1))->fingerprint == preset->fingerprint);
  CHECK(store.Open(fixture.Request("obs-noise-low", 2))->fingerprint != preset->fingerprint);
  CHECK(fixture.CacheCount() == 3);
}

TEST_CASE("what is prepared can be opened without preparing anything") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  constexpr auto kGiveNull = DatasetStore::IfMissing::kGiveNull;
  for (const char* corruptions : {"", "hidden-high"}) {
    const DatasetRequest request = fixture.Request(corruptions);
    const auto missing = store.Open(request, kGiveNull);
    REQUIRE(missing.ok());
    CHECK(missing->dataset == nullptr);
    const auto opened = store.Open(request);
    REQUIRE(opened.ok());
    const auto prepared = store.Open(request, kGiveNull);
    REQUIRE(prepared.ok());
    REQUIRE(prepared->dataset != nullptr);
    CHECK(prepared->fingerprint == opened->fingerprint);
    CHECK(prepared->info.sha256 == opened->info.sha256);
    CHECK(prepared->hidden_dimensions == opened->hidden_dimensions);
  }
}

TEST_CASE("caches that were opened longest ago make room, and come back when asked for by name") {
  const StoreFixture fixture;
  const uint64_t one = fixture.Store().Open(fixture.Request(""))->dataset->cache().bytes();
  DatasetStore store = fixture.Store(3 * one);
  std::string first;
  for (uint64_t seed = 0; seed < 5; ++seed) {
    const auto opened = store.Open(fixture.Request("obs-noise=1", seed));
    REQUIRE(opened.ok());
    if (seed == 0) first = opened->fingerprint;
    CHECK(fixture.CacheCount() <= 3);
  }
  CHECK(store.Load(first).status().code() == StatusCode::kUnknownName);
  CHECK(store.Open(fixture.Request("obs-noise=1", 0))->fingerprint == first);
}

TEST_CASE("a full disk while deriving is an error that leaves no cache") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  REQUIRE(store.Open(fixture.Request("")).ok());
  {
    const FileSizeLimit full(10'000);
    CHECK(store.Open(fixture.Request("hidden-high")).status().code() == StatusCode::kIoError);
  }
  CHECK(fixture.CacheCount() == 1);
  CHECK(std::distance(fs::directory_iterator(fixture.folder.File(".cache")), {}) == 2);
  CHECK(store.Open(fixture.Request("hidden-high")).ok());
}

TEST_CASE("what dead processes left half-made is removed, what live ones make is not") {
  const StoreFixture fixture;
  const std::string dead = fixture.folder.File(".cache/unfinished-2147483647-0");
  const std::string live = fixture.folder.File(".cache/unfinished-1-0");
  fs::create_directories(dead);
  fs::create_directories(live);
  fixture.Store().RemoveUnfinished();
  CHECK_FALSE(fs::exists(dead));
  CHECK(fs::exists(live));
}

}  // namespace
}  // namespace b4mrl
