#include <sys/stat.h>
#include <atomic>

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>

#include "data/columns/column_cache.h"
#include "data/columns/dataset.h"
#include "data/d4rl/import_dataset.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/rng.h"
#include "server/datasets/importer.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

const std::string kProgram = B4MRL_BINARY_DIR "/b4mrl-serve";

// A data file and a cache folder, and one import of it in a real child process.
struct ImportFixture {
  TemporaryFolder folder;
  std::string file = folder.File("x.h5");
  std::string cache = folder.File("cache");

  Result<ImportedDataset> Import(const std::string& program = kProgram,
                                 int64_t deadline_ms = 60'000,
                                 uint64_t max_cache_bytes = 1ull << 30) {
    std::filesystem::remove_all(cache);
    std::filesystem::create_directory(cache);
    return ImportInChild(program, {file, cache, max_cache_bytes}, Deadline::AfterMs(deadline_ms));
  }
  std::shared_ptr<const Dataset> ImportAndOpen() {
    const auto rows = Import();
    INFO(rows.status().ToString());
    REQUIRE(rows.ok());
    const auto dataset = Dataset::Open(ImportedCachePath(cache));
    REQUIRE(dataset.ok());
    REQUIRE((*dataset)->cache().Verify([] { return false; }).ok());
    return *dataset;
  }
  bool HasCache() const { return std::filesystem::exists(ImportedCachePath(cache)); }
  void WriteScript(const std::string& body) {
    WriteBytes(folder.File("program"), "#!/bin/sh\n" + body);
    chmod(folder.File("program").c_str(), 0755);
  }
};

template <typename T>
std::vector<T> ToVector(std::span<const T> values) {
  return {values.begin(), values.end()};
}

TEST_CASE("an imported dataset equals the file") {
  ImportFixture fixture;
  const ExampleDataset data = MakeExampleDataset({100, 70'000, 3}, 17, 6);
  REQUIRE(WriteExample(fixture.file, data).ok());
  const auto dataset = fixture.ImportAndOpen();
  const TransitionColumns& columns = dataset->columns();
  CHECK(columns.rows == data.rows());
  CHECK(ToVector(columns.observations) == data.observations);
  CHECK(ToVector(columns.next_observations) == data.next_observations);
  CHECK(ToVector(columns.actions) == data.actions);
  CHECK(ToVector(columns.rewards) == data.rewards);
  CHECK(ToVector(columns.terminals) == data.terminals);
  CHECK(ToVector(columns.timeouts) == data.timeouts);
  CHECK(dataset->statistics().episodes == 3);
}

// Columns of old files: float64, (N, 1), no time-outs, no next observations.
void WriteOldFile(const std::string& path, size_t rows) {
  auto file = Hdf5Writer::Create(path);
  REQUIRE(file.ok());
  const auto add = [&](const char* name, Hdf5Type type, uint64_t width) {
    const auto column = file->CreateColumn(name, {type, width, 64, 4});
    REQUIRE(column.ok());
    for (size_t row = 0; row < rows; ++row) {
      for (uint64_t i = 0; i < std::max<uint64_t>(width, 1); ++i) {
        const double value = static_cast<double>(row * 10 + i);
        const uint8_t flag = row == 2;
        if (type == Hdf5Type::kFloat64) {
          // Rows are whole: only width 1 may be written one value at a time.
          std::vector<double> whole(width, value);
          REQUIRE(file->Append(*column, std::span<const double>(whole)).ok());
          break;
        }
        REQUIRE(file->Append(*column, std::span<const uint8_t>(&flag, 1)).ok());
      }
    }
  };
  add("observations", Hdf5Type::kFloat64, 3);
  add("actions", Hdf5Type::kFloat64, 2);
  add("rewards", Hdf5Type::kFloat64, 1);
  add("terminals", Hdf5Type::kInteger, 1);
  REQUIRE(file->Commit().ok());
}

TEST_CASE("old files: float64, shape (N, 1), no time-outs, no next observations") {
  ImportFixture fixture;
  WriteOldFile(fixture.file, 2500);
  const auto dataset = fixture.ImportAndOpen();
  CHECK(dataset->property("transition_rule") == "d4rl");
  // A terminal at row 2; time-outs are inferred at rows 1002 and 2002, and both go, as does the
  // last.
  const TransitionColumns& columns = dataset->columns();
  CHECK(columns.rows == 2497);
  CHECK(columns.terminals[2] == 1);
  CHECK(columns.rewards[1002] == 10030.0f);
  CHECK(columns.timeouts[1001] == 1);
  CHECK(columns.next_observations[1001 * 3] == 10020.0f);
  CHECK(columns.next_observations[1002 * 3] == 10040.0f);
  CHECK(dataset->statistics().episodes == 4);  // of the file, not of the rows that are left
}

TEST_CASE("missing columns, unequal lengths and wrong types are named") {
  ImportFixture fixture;
  struct Plan {
    const char* omit;
    const char* shorten;
    const char* as_flags;
    StatusCode code;
    const char* named;
  };
  const Plan plans[] = {
      {"observations", "", "", StatusCode::kUnknownName, "observations"},
      {"rewards", "", "", StatusCode::kUnknownName, "rewards"},
      {"terminals", "", "", StatusCode::kUnknownName, "terminals"},
      {"", "actions", "", StatusCode::kInvalidArgument, "actions"},
      {"", "terminals", "", StatusCode::kInvalidArgument, "terminals"},
      {"", "next_observations", "", StatusCode::kInvalidArgument, "next_observations"},
      {"", "", "rewards", StatusCode::kInvalidArgument, "rewards"},
  };
  for (const Plan& plan : plans) {
    CAPTURE(plan.omit, plan.shorten, plan.as_flags);
    auto file = Hdf5Writer::Create(fixture.file);
    REQUIRE(file.ok());
    const auto add = [&](const std::string& name, uint64_t width, bool flags) {
      if (name == plan.omit) return;
      flags |= name == plan.as_flags;
      const auto column =
          file->CreateColumn(name, {flags ? Hdf5Type::kBool : Hdf5Type::kFloat32, width, 64, 0});
      const size_t rows = name == plan.shorten ? 9 : 10;
      const std::vector<uint8_t> some_flags(rows);
      const std::vector<float> values(rows * std::max<uint64_t>(width, 1), 0.5f);
      REQUIRE((flags ? file->Append(*column, std::span(some_flags))
                     : file->Append(*column, std::span(values)))
                  .ok());
    };
    add("observations", 3, false);
    add("actions", 2, false);
    add("next_observations", 3, false);
    add("rewards", 0, false);
    add("terminals", 0, true);
    REQUIRE(file->Commit().ok());
    const auto result = fixture.Import();
    CHECK(result.status().code() == plan.code);
    CHECK_THAT(result.status().message(), Catch::Contains(plan.named));
    CHECK_FALSE(fixture.HasCache());
  }
}

TEST_CASE("files that are missing, empty, no HDF5, or no files are typed errors") {
  ImportFixture fixture;
  CHECK(fixture.Import().status().code() == StatusCode::kIoError);
  WriteBytes(fixture.file, "");
  CHECK(fixture.Import().status().code() == StatusCode::kDataLoss);
  WriteBytes(fixture.file, "This is text.");
  CHECK(fixture.Import().status().code() == StatusCode::kDataLoss);
  fixture.file = fixture.folder.path();
  CHECK(fixture.Import().status().code() == StatusCode::kInvalidArgument);
  fixture.file = "/dev/zero";
  CHECK(fixture.Import().status().code() == StatusCode::kInvalidArgument);
  CHECK_FALSE(fixture.HasCache());
}

TEST_CASE("a file truncated anywhere is refused") {
  ImportFixture fixture;
  REQUIRE(WriteExample(fixture.file, MakeExampleDataset({50})).ok());
  const std::string whole = ReadBytes(fixture.file);
  constexpr size_t kCuts = 24;
  for (size_t i = 0; i < kCuts; ++i) {
    const size_t size = whole.size() * i / kCuts;
    CAPTURE(size);
    WriteBytes(fixture.file, whole.substr(0, size));
    CHECK_FALSE(fixture.Import().ok());
    CHECK_FALSE(fixture.HasCache());
  }
}

TEST_CASE("a file with random bytes changed is imported whole or refused") {
  ImportFixture fixture;
  const ExampleDataset data = MakeExampleDataset({50});
  REQUIRE(WriteExample(fixture.file, data).ok());
  const std::string whole = ReadBytes(fixture.file);
  Rng rng(5, "mutations");
  int imported = 0;
  for (int i = 0; i < 60; ++i) {
    CAPTURE(i);
    std::string bytes = whole;
    for (uint64_t change = rng.Below(8) + 1; change > 0; --change) {
      bytes[rng.Below(bytes.size())] = static_cast<char>(rng.Below(256));
    }
    WriteBytes(fixture.file, bytes);
    const auto result = fixture.Import();
    if (!result.ok()) {
      CHECK_FALSE(fixture.HasCache());
      continue;
    }
    ++imported;
    const auto dataset = Dataset::Open(ImportedCachePath(fixture.cache));
    REQUIRE(dataset.ok());
    CHECK((*dataset)->rows() == result->rows);
    CHECK((*dataset)->cache().Verify([] { return false; }).ok());
  }
  CHECK(imported < 60);
}

TEST_CASE("what would take more than the caches may is refused before it is written") {
  ImportFixture fixture;
  REQUIRE(WriteExample(fixture.file, MakeExampleDataset({50})).ok());
  // 50 rows of 3 + 3 + 2 + 1 floats and two flags.
  CHECK(fixture.Import(kProgram, 60'000, 50 * 38).ok());
  CHECK(fixture.Import(kProgram, 60'000, 50 * 38 - 1).status().code() ==
        StatusCode::kLimitExceeded);
  CHECK_FALSE(fixture.HasCache());
}

TEST_CASE("a cache with a file that is larger than the sandbox allows lies in the dataset") {
  ImportFixture fixture;
  REQUIRE(WriteExample(fixture.file, MakeExampleDataset({2}, 17, 6)).ok());
  // 2 rows of 17 + 17 + 6 + 1 floats and two flags fit, but not their statistics beside them.
  const Status refused = fixture.Import(kProgram, 60'000, 2 * 166).status();
  CHECK(refused.code() == StatusCode::kLimitExceeded);
  CHECK_THAT(refused.message(), Catch::Contains("more than 332 bytes, allowed: 64 times"));
  CHECK_FALSE(fixture.HasCache());
}

TEST_CASE("an importer that crashes, hangs or babbles becomes an error") {
  ImportFixture fixture;
  fixture.WriteScript("kill -SEGV $$\n");
  const auto crashed = fixture.Import(fixture.folder.File("program"));
  CHECK(crashed.status().code() == StatusCode::kDataLoss);
  CHECK_THAT(crashed.status().message(), Catch::Contains("signal 11"));
  fixture.WriteScript("exec sleep 100\n");
  CHECK(fixture.Import(fixture.folder.File("program"), 100).status().code() ==
        StatusCode::kUnavailable);
  const std::atomic<bool> cancelled{true};
  CHECK(ImportInChild(fixture.folder.File("program"), {fixture.file, fixture.cache, 1},
                      Deadline::AfterMs(60'000), &cancelled)
            .status()
            .code() == StatusCode::kUnavailable);
  fixture.WriteScript("exec >&-\nexec sleep 100\n");
  CHECK_FALSE(fixture.Import(fixture.folder.File("program"), 100).ok());
  fixture.WriteScript("exec cat /dev/zero\n");
  CHECK(fixture.Import(fixture.folder.File("program")).status().code() == StatusCode::kDataLoss);
  for (const char* rows : {"-1", "1.5", "\"1\"", "null"}) {
    fixture.WriteScript(std::string("echo '{\"ok\": true, \"rows\": ") + rows + "}'\n");
    CHECK(fixture.Import(fixture.folder.File("program")).status().code() == StatusCode::kDataLoss);
  }
  const std::string deep = std::string(1000, '[') + std::string(1000, ']');
  fixture.WriteScript(R"(echo '{"ok": true, "rows": 1, "behaviour_policy": "", "provenance": )" +
                      deep + "}'\n");
  CHECK_THAT(fixture.Import(fixture.folder.File("program")).status().message(),
             Catch::Contains("no usable answer"));
  fixture.WriteScript("exit 0\n");
  CHECK(fixture.Import(fixture.folder.File("program")).status().code() == StatusCode::kDataLoss);
  CHECK(fixture.Import(fixture.folder.File("none")).status().code() == StatusCode::kIoError);
}

TEST_CASE("an import says where the rows come from, and keeps that out of the cache") {
  ImportFixture fixture;
  const ExampleDataset data = Hiding({9, 16}, MakeExampleDataset({50}, 17, 6));
  REQUIRE(WriteExample(fixture.file, data).ok());
  const auto plain = fixture.ImportAndOpen();
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = {9, 16};
  provenance.parts = {{"SAC, iteration 5", "ab", 3, 50}};
  provenance.command = "b4mrl \x01\xff";
  REQUIRE(WriteExample(fixture.file, data, provenance).ok());
  const auto imported = fixture.Import();
  REQUIRE(imported.ok());
  CHECK(imported->behaviour_policy == "SAC, iteration 5");
  provenance.command = "b4mrl ??";  // printable
  CHECK(imported->provenance == provenance);
  const auto same = Dataset::Open(ImportedCachePath(fixture.cache));
  REQUIRE(same.ok());
  CHECK((*same)->cache().properties() == plain->cache().properties());
}

TEST_CASE("a file that hides dimensions which it does not have is refused") {
  ImportFixture fixture;
  DatasetProvenance provenance;
  provenance.hidden_dimensions = {2, 3};
  REQUIRE(WriteExample(fixture.file, MakeExampleDataset({5}, 3, 2), provenance).ok());
  CHECK(fixture.Import().status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("a file that shows a dimension which it says is hidden is refused with the row") {
  ImportFixture fixture;
  DatasetProvenance provenance;
  provenance.hidden_dimensions = {0, 2};
  ExampleDataset data = Hiding({0, 2}, MakeExampleDataset({20'000}, 3, 2));
  data.observations[4 * 3 + 2] = -0.0f;  // is 0, too
  REQUIRE(WriteExample(fixture.file, data, provenance).ok());
  CHECK(fixture.Import().ok());
  data.next_observations[19'000 * 3 + 2] = 0.5f;
  REQUIRE(WriteExample(fixture.file, data, provenance).ok());
  Status status = fixture.Import().status();
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(status.message(),
             Catch::Contains("dimension 2 in row 19000 of 'next_observations' is 0.5, allowed: 0"));
  data.observations[4 * 3] = NAN;
  REQUIRE(WriteExample(fixture.file, data, provenance).ok());
  status = fixture.Import().status();
  CHECK_THAT(status.message(), Catch::Contains("dimension 0 in row 4 of 'observations'"));
  CHECK_FALSE(fixture.HasCache());
}

}  // namespace
}  // namespace b4mrl
