#include "server/datasets/dataset_store.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "data/files/file_hash.h"
#include "tests/data/file_size_limit.h"
#include "tests/data/manifest_schema.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("A name without a version means the newest version, unless a file has that very name") {
  const StoreFixture fixture;
  for (const char* name :
       {"expert-v0", "expert-v9", "expert-v10", "expert-vx", "expert-v11-mine"}) {
    REQUIRE(WriteExample(fixture.folder.File(fmt::format("HalfCheetah/{}.h5", name)), fixture.data)
                .ok());
  }
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium-v3.h5"), fixture.data).ok());
  DatasetStore store = fixture.Store();
  const auto full_name = [&](const std::string& name) {
    DatasetRequest request = StoreFixture::Request("");
    request.name = name;
    return StoreFixture::OpenMade(store, request)->info.name;
  };
  CHECK(full_name("HalfCheetah/expert") == "HalfCheetah/expert-v10");
  CHECK(full_name("HalfCheetah/expert-v9") == "HalfCheetah/expert-v9");
  CHECK(full_name("HalfCheetah/medium") == "HalfCheetah/medium");
  DatasetRequest request = StoreFixture::Request("");
  request.name = "HalfCheetah/expert-v1";
  CHECK(store.Open(request).status().code() == StatusCode::kUnknownName);
}

TEST_CASE("what is no fingerprint, and what a rule leaves no row of, is named in the error") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  const Status malformed = store.Load("F00").status();
  CHECK(malformed.code() == StatusCode::kUnknownName);
  CHECK(malformed.message() == "fingerprint is 'F00', allowed: 32 lower-case hexadecimal digits");
  // Its one row ended by time-out.
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/short.h5"), MakeExampleDataset({1}, 17, 6))
              .ok());
  DatasetRequest request = StoreFixture::Request("");
  request.name = "HalfCheetah/short";
  REQUIRE(StoreFixture::OpenMade(store, request).ok());
  request.rule = TransitionRule::kD4rl;
  const Status empty = StoreFixture::OpenMade(store, request).status();
  CHECK(empty.code() == StatusCode::kInvalidArgument);
  CHECK(empty.message() ==
        "HalfCheetah/short with transition_rule d4rl: the dataset has no transitions");
}

TEST_CASE("an unchanged file is imported once, also by another process") {
  const StoreFixture fixture;
  const auto first = fixture.OpenMade("");
  REQUIRE(first.ok());
  DatasetStore other = fixture.Store(1ull << 30, "/no/such/program");
  const auto second = fixture.OpenMade(other, fixture.Request(""));
  REQUIRE(second.ok());
  CHECK(second->fingerprint == first->fingerprint);
  CHECK(second->info.sha256 == first->info.sha256);
  CHECK(first->info.sha256 == Sha256OfFile(fixture.folder.File("HalfCheetah/medium.h5")).value());
  // Written again, it is another file as far as one can see without reading it.
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data).ok());
  CHECK(fixture.OpenMade(other, fixture.Request("")).status().code() == StatusCode::kIoError);
  CHECK(fixture.OpenMade("")->fingerprint == first->fingerprint);
}

TEST_CASE("a file with a long text about its behaviour policy opens after one import") {
  const StoreFixture fixture;
  // A byte takes six in JSON, so more than an entry of the index may have.
  const std::string policy(12'000, '\x01');
  REQUIRE(
      WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data, "", policy).ok());
  DatasetStore store = fixture.Store();
  const std::atomic<bool> cancelled{false};
  REQUIRE(store.Import("HalfCheetah/medium", cancelled).ok());
  const auto opened = store.Open(StoreFixture::Request(""));
  REQUIRE(opened.ok());
  CHECK(opened->dataset != nullptr);
  CHECK(opened->info.behaviour_policy == std::string(200, '?'));
}

TEST_CASE("a file that was overwritten in place, at equal size, is imported again") {
  const StoreFixture fixture;
  const std::string path = fixture.folder.File("HalfCheetah/medium.h5");
  const std::string other = fixture.folder.File("other.h5");
  REQUIRE(WriteExample(path, fixture.data, "HalfCheetah").ok());
  REQUIRE(WriteExample(other, fixture.data, "halfcheetah").ok());
  const std::string first = fixture.OpenMade("")->info.sha256;
  const std::string bytes = ReadBytes(other);
  REQUIRE(bytes.size() == fs::file_size(path));
  WriteBytes(path, bytes);
  fs::last_write_time(path, fs::last_write_time(path) + std::chrono::seconds(1));
  const auto second = fixture.OpenMade("");
  CHECK(second->info.sha256 != first);
  CHECK(second->environment == "halfcheetah");
}

TEST_CASE("equal corruptions share a cache, however they are written") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  const auto preset = fixture.OpenMade(store, fixture.Request("obs-noise-low", 1));
  REQUIRE(preset.ok());
  CHECK(fixture.OpenMade(store, fixture.Request("obs-noise=0.010", 1))->fingerprint ==
        preset->fingerprint);
  CHECK(fixture.OpenMade(store, fixture.Request("obs-noise-low", 2))->fingerprint !=
        preset->fingerprint);
  CHECK(fixture.CacheCount() == 3);
}

TEST_CASE("opening says what is missing and makes nothing") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  using Missing = OpenedDataset::Missing;
  for (const auto& [corruptions, what] :
       {std::pair{"", Missing::kImport}, std::pair{"hidden-high", Missing::kDerivation}}) {
    const DatasetRequest request = fixture.Request(corruptions);
    const auto missing = store.Open(request);
    REQUIRE(missing.ok());
    CHECK(missing->dataset == nullptr);
    CHECK(missing->missing == what);
    CHECK(missing->source_bytes > 0);
    const auto made = fixture.OpenMade(store, request);
    REQUIRE(made.ok());
    if (what == Missing::kDerivation) {
      CHECK(made->fingerprint == missing->fingerprint);
      // While a caller keeps the source, deriving and opening map it no second time.
      REQUIRE(missing->source != nullptr);
      CHECK(made->source == missing->source);
      CHECK(*store.Load(missing->source_fingerprint) == missing->source);
    }
    const auto prepared = store.Open(request);
    REQUIRE(prepared.ok());
    REQUIRE(prepared->dataset != nullptr);
    CHECK(prepared->missing == Missing::kNothing);
    CHECK(prepared->fingerprint == made->fingerprint);
    CHECK(prepared->info.sha256 == made->info.sha256);
    CHECK(prepared->hidden_dimensions == made->hidden_dimensions);
  }
}

TEST_CASE("work that was cancelled leaves nothing") {
  const StoreFixture fixture;
  const std::atomic<bool> cancelled{true};
  DatasetStore store = fixture.Store();
  CHECK(store.Import("HalfCheetah/medium", cancelled).status().code() == StatusCode::kUnavailable);
  REQUIRE(fixture.OpenMade("").ok());
  const DatasetRequest noisy = fixture.Request("obs-noise=1");
  CHECK(store.Derive(noisy, cancelled).status().code() == StatusCode::kUnavailable);
  DatasetRequest d4rl = fixture.Request("");
  d4rl.rule = TransitionRule::kD4rl;
  CHECK(store.Derive(d4rl, cancelled).status().code() == StatusCode::kUnavailable);
  CHECK(fixture.CacheCount() == 1);
  CHECK(fixture.UnfinishedCount() == 0);
}

TEST_CASE("caches that were opened longest ago make room, and come back when asked for by name") {
  const StoreFixture fixture;
  const uint64_t one = fixture.CacheBytes(fixture.OpenMade("")->fingerprint);
  DatasetStore store = fixture.Store(3 * one + one / 2);
  std::vector<std::string> made;
  for (uint64_t seed = 0; seed < 5; ++seed) {
    const auto opened = fixture.OpenMade(store, fixture.Request("obs-noise=1", seed));
    REQUIRE(opened.ok());
    made.push_back(opened->fingerprint);
    CHECK(fixture.CacheCount() <= 3);
    CHECK(fixture.HasCache(made.back()));
    CHECK(fixture.HasCache(made.front()));
    // Opened again and again, the first one is never the one that was opened longest ago.
    CHECK(fixture.OpenMade(store, fixture.Request("obs-noise=1", 0))->fingerprint == made[0]);
    // A file system's clock ticks every few milliseconds, and this takes less.
    if (seed == 0) continue;
    const std::string newest = fixture.folder.File(".b4mrl-cache/" + made.back());
    fs::last_write_time(newest, fs::last_write_time(newest) - std::chrono::hours(1));
  }
  CHECK(store.Load(made[1]).status().code() == StatusCode::kUnknownName);
  CHECK(store.Load(made[4]).ok());
  CHECK(fixture.OpenMade(store, fixture.Request("obs-noise=1", 1))->fingerprint == made[1]);
}

TEST_CASE("what is mapped never makes room, whoever mapped it") {
  const StoreFixture fixture;
  const auto source = fixture.OpenMade("");  // held, by another store as by another process
  const uint64_t one = fixture.CacheBytes(source->fingerprint);
  DatasetStore store = fixture.Store(3 * one + one / 2);
  const auto busiest = fixture.OpenMade(store, fixture.Request("obs-noise=1", 0));
  for (uint64_t seed = 1; seed < 6; ++seed) {
    REQUIRE(fixture.OpenMade(store, fixture.Request("obs-noise=1", seed)).ok());
    CHECK(fixture.CacheCount() <= 3);
  }
  CHECK(fixture.HasCache(source->fingerprint));
  CHECK(fixture.HasCache(busiest->fingerprint));
  // With all of the room in use, there is none for another.
  const auto third = fixture.OpenMade(store, fixture.Request("obs-noise=1", 9));
  REQUIRE(third.ok());
  const auto refused = fixture.OpenMade(store, fixture.Request("obs-noise=1", 10));
  CHECK(refused.status().code() == StatusCode::kLimitExceeded);
  CHECK(fixture.CacheCount() == 3);
  CHECK(fixture.HasCache(third->fingerprint));
}

TEST_CASE("no cache goes for a file that is not found good, or that takes more than all may") {
  const StoreFixture fixture;
  const std::string first = fixture.OpenMade("")->fingerprint;
  const std::string second = fixture.OpenMade("hidden-high")->fingerprint;
  const uint64_t one = fixture.CacheBytes(first);
  DatasetStore store = fixture.Store(2 * one + one / 2);
  WriteBytes(fixture.folder.File("HalfCheetah/sparse.h5"), "");
  fs::resize_file(fixture.folder.File("HalfCheetah/sparse.h5"), 70ull << 30);
  WriteBytes(fixture.folder.File("HalfCheetah/text.h5"), std::string(3 * one, 'x'));
  REQUIRE(
      WriteExample(fixture.folder.File("HalfCheetah/large.h5"), MakeExampleDataset({3000}, 17, 6))
          .ok());
  const auto code_of = [&](const std::string& name) {
    return fixture.OpenMade(store, {name, {}, 0, TransitionRule::kStored}).status().code();
  };
  CHECK(code_of("HalfCheetah/sparse") == StatusCode::kDataLoss);
  CHECK(code_of("HalfCheetah/text") == StatusCode::kDataLoss);
  CHECK(code_of("HalfCheetah/large") == StatusCode::kLimitExceeded);
  CHECK(fixture.HasCache(first));
  CHECK(fixture.HasCache(second));
  // A sparse file among the caches takes no room.
  WriteBytes(fixture.folder.File(".b4mrl-cache/" + second + "/more"), "");
  fs::resize_file(fixture.folder.File(".b4mrl-cache/" + second + "/more"), 70ull << 30);
  CHECK(fixture.OpenMade(store, fixture.Request("", 0)).ok());
  REQUIRE(fixture.OpenMade(store, fixture.Request("hidden=1")).ok());
  CHECK(fixture.CacheCount() == 2);
}

TEST_CASE("stores that import one file at once import it once, and wait for each other") {
  const StoreFixture fixture;
  const std::string tries = fixture.folder.File("tries");
  const std::string importer = fixture.WriteScript(
      "echo x >>" + tries + "\nexec '" B4MRL_BINARY_DIR "/b4mrl-serve' \"$@\"\n");
  constexpr size_t kStores = 4;
  std::vector<Result<OpenedDataset>> opened(kStores, Status(StatusCode::kInternal, "not opened"));
  std::vector<std::thread> threads;
  for (Result<OpenedDataset>& result : opened) {
    threads.emplace_back([&] {
      DatasetStore store = fixture.Store(1ull << 30, importer);
      result = StoreFixture::OpenMade(store, StoreFixture::Request("obs-noise=1"));
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Result<OpenedDataset>& result : opened) {
    INFO(result.status().ToString());
    REQUIRE(result.ok());
    CHECK(result->fingerprint == opened[0]->fingerprint);
    CHECK(result->dataset->rows() == fixture.data.rows());
  }
  CHECK(ReadBytes(tries) == "x\n");
  CHECK(fixture.CacheCount() == 2);
  CHECK(fixture.UnfinishedCount() == 0);
}

TEST_CASE("what waits for another's work ends when it is cancelled") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  REQUIRE(fixture.OpenMade(store, fixture.Request("")).ok());
  const CacheFolder cache(fixture.folder.path(), 1ull << 30);
  const std::atomic<bool> not_cancelled{false};
  const auto noisy = store.Open(fixture.Request("obs-noise=1"));
  const auto held = cache.Lock(noisy->fingerprint, not_cancelled);
  REQUIRE(held.ok());
  const std::atomic<bool> cancelled{true};
  CHECK(store.Derive(fixture.Request("obs-noise=1"), cancelled).status().code() ==
        StatusCode::kUnavailable);
}

TEST_CASE("an import that failed for its file is not tried again until the file changes") {
  const StoreFixture fixture;
  const std::string tries = fixture.folder.File("tries");
  const auto answering = [&](const std::string& answer) {
    return fixture.WriteScript("echo x >>" + tries + "\necho '" + answer + "'\n");
  };
  const std::string program = answering(R"({"ok": false, "code": 12, "message": "damaged"})");
  DatasetStore store = fixture.Store(1ull << 30, program);
  for (int i = 0; i < 3; ++i) {
    const auto opened = fixture.OpenMade(store, fixture.Request(""));
    CHECK(opened.status().code() == StatusCode::kDataLoss);
    CHECK_THAT(opened.status().message(), Catch::Contains("damaged"));
  }
  CHECK(ReadBytes(tries) == "x\n");
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data).ok());
  // What is not the file's fault is tried again.
  answering(R"({"ok": false, "code": 13, "message": "disk full"})");
  for (int i = 0; i < 2; ++i) {
    CHECK(fixture.OpenMade(store, fixture.Request("")).status().code() == StatusCode::kIoError);
  }
  CHECK(ReadBytes(tries) == "x\nx\nx\n");
}

TEST_CASE("a cache of another schema is made anew") {
  const StoreFixture fixture;
  const std::string fingerprint = fixture.OpenMade("")->fingerprint;
  const std::string path = fixture.folder.File(".b4mrl-cache/" + fingerprint + "/manifest.json");
  ChangeManifestSchema(path, 2);
  const auto again = fixture.OpenMade("");
  REQUIRE(again.ok());
  CHECK(again->fingerprint == fingerprint);
  CHECK(nlohmann::json::parse(ReadBytes(path))["schema"] == 1);
}

TEST_CASE("caches are their user's alone, unless the data folder is its group's") {
  const mode_t umask_before = umask(0);
  umask(umask_before);
  for (const mode_t mask : {0, 0022, 0077}) {
    for (const mode_t mode : {0755, 0775, 0770}) {
      CAPTURE(mask, mode);
      const StoreFixture fixture;
      REQUIRE(chmod(fixture.folder.path().c_str(), mode) == 0);
      umask(mask);
      const bool opened = fixture.OpenMade("hidden-high").ok();
      umask(umask_before);
      CHECK(opened);
      const mode_t folders = (mode & 0020) != 0 ? mode : 0700;
      CHECK(fixture.ModeOf(".b4mrl-cache") == folders);
      for (const auto& entry :
           fs::recursive_directory_iterator(fixture.folder.File(".b4mrl-cache"))) {
        CAPTURE(entry.path().string());
        const mode_t wanted = entry.is_directory() ? folders : folders & 0666;
        CHECK(fixture.ModeOf(fs::relative(entry.path(), fixture.folder.path())) == wanted);
      }
    }
  }
  // What an earlier version left open is closed when a worker starts.
  const StoreFixture fixture;
  REQUIRE(fixture.OpenMade("").ok());
  fs::permissions(fixture.folder.File(".b4mrl-cache"), fs::perms(0755));
  fixture.Store().TidyUp();
  CHECK(fixture.ModeOf(".b4mrl-cache") == 0700);
}

TEST_CASE("a full disk while deriving is an error that leaves no cache") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  REQUIRE(fixture.OpenMade(store, fixture.Request("")).ok());
  {
    const FileSizeLimit full(10'000);
    CHECK(fixture.OpenMade(store, fixture.Request("hidden-high")).status().code() ==
          StatusCode::kIoError);
  }
  CHECK(fixture.CacheCount() == 1);
  CHECK(fixture.UnfinishedCount() == 0);
  CHECK(fixture.OpenMade(store, fixture.Request("hidden-high")).ok());
}

TEST_CASE("what dead processes left half-made is removed, what live ones make is not") {
  const StoreFixture fixture;
  const std::string dead = fixture.folder.File(".b4mrl-cache/unfinished-aa-abcdef");
  const std::string of_older_version = fixture.folder.File(".b4mrl-cache/unfinished-12-import-0");
  const std::string live = fixture.folder.File(".b4mrl-cache/unfinished-bb-abcdef");
  for (const std::string& path : {dead, of_older_version, live}) fs::create_directories(path);
  const std::atomic<bool> cancelled{false};
  const CacheFolder cache(fixture.folder.path(), 1ull << 30);
  const auto lock = cache.Lock("bb", cancelled);
  REQUIRE(lock.ok());
  fixture.Store().TidyUp();
  CHECK_FALSE(fs::exists(dead));
  CHECK_FALSE(fs::exists(of_older_version));
  CHECK(fs::exists(live));
  CHECK(fs::exists(fixture.folder.File(".b4mrl-cache/locks/bb")));
  CHECK_FALSE(fs::exists(fixture.folder.File(".b4mrl-cache/locks/aa")));
}

}  // namespace
}  // namespace b4mrl
