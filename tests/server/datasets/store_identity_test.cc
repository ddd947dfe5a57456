// Which datasets are one dataset, and which environment and hidden dimensions a dataset has.
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>

#include "data/files/file_hash.h"
#include "data/hdf5/hdf5_file.h"
#include "server/datasets/identity.h"
#include "tests/data/manifest_schema.h"
#include "tests/server/datasets/store_fixture.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// A script in the importer's place, which answers every file with the columns in a folder, and
// claims another dataset's names and these hidden dimensions for it.
std::string LyingImporter(const StoreFixture& fixture, const std::string& columns,
                          const std::string& fingerprint, const std::string& hidden = "") {
  return fixture.WriteScript(
      "cp -r " + columns + " \"$6/imported\"\n" +
      R"(echo '{"ok": true, "rows": 1, "behaviour_policy": "", "provenance": )" +
      R"({"name": "", "environment": "", "simulator": "", "recipe": "", )" +
      R"("engine": "", "program": "", "command": "", "license": "", )" +
      R"("hidden_dimensions": [)" + hidden + R"(], "history_length": 1, "parts": []}, )" +
      R"("sha256": "ab", "columns_sha256": "cd", "fingerprint": ")" + fingerprint + "\"}'\n");
}

TEST_CASE("an importer cannot pass its columns off as another file's") {
  const StoreFixture fixture;
  const auto victim = fixture.OpenMade("");
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/evil.h5"), MakeExampleDataset({5}, 17, 6))
              .ok());
  // Copies another dataset's cache with other statistics and claims the other's names.
  const std::string stolen = fixture.folder.File("stolen");
  fs::copy(fixture.folder.File(".b4mrl-cache/" + victim->fingerprint), stolen);
  ChangeManifest(stolen + "/manifest.json", [](nlohmann::json& manifest) {
    manifest["properties"]["transition_rule"] = "d4rl";
  });
  DatasetStore store =
      fixture.Store(1ull << 30, LyingImporter(fixture, stolen, victim->fingerprint));
  const auto evil = fixture.OpenMade(store, {"HalfCheetah/evil", {}, 0, TransitionRule::kStored});
  INFO(evil.status().ToString());
  REQUIRE(evil.ok());
  CHECK(evil->fingerprint != victim->fingerprint);
  CHECK(evil->info.sha256 == Sha256OfFile(fixture.folder.File("HalfCheetah/evil.h5")).value());
  CHECK(evil->info.columns_sha256 == victim->info.columns_sha256);  // of what it did write
}

TEST_CASE("an importer cannot hide dimensions that the columns have not") {
  const StoreFixture fixture;
  const auto honest = fixture.OpenMade("");
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/evil.h5"), fixture.data).ok());
  const std::string columns = fixture.folder.File(".b4mrl-cache/" + honest->fingerprint);
  for (const auto& [hidden, is_refused] : {std::pair{"9, 4000", true}, std::pair{"9", false}}) {
    CAPTURE(hidden);
    DatasetStore store =
        fixture.Store(1ull << 30, LyingImporter(fixture, columns, honest->fingerprint, hidden));
    const Status opened =
        fixture
            .OpenMade(store,
                      {"HalfCheetah/evil", {{"obs-noise", "0.1"}}, 0, TransitionRule::kStored})
            .status();
    INFO(opened.ToString());
    CHECK(opened.ok() != is_refused);
    if (is_refused) CHECK_THAT(opened.message(), Catch::Contains("is 4000, allowed: 0..16"));
    fs::remove_all(fixture.folder.File(".b4mrl-cache/index"));
  }
}

TEST_CASE("files with equal rows are one dataset, whatever else they say") {
  const StoreFixture fixture;
  const auto before = fixture.OpenMade("obs-noise=1");
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.command = "b4mrl dataset make HalfCheetah/medium-v0";
  REQUIRE(
      WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data, provenance).ok());
  const auto after = fixture.OpenMade("obs-noise=1");
  REQUIRE(after.ok());
  CHECK(after->info.sha256 != before->info.sha256);
  CHECK(after->info.columns_sha256 == before->info.columns_sha256);
  CHECK(after->fingerprint == before->fingerprint);
  CHECK(after->provenance == provenance);
  CHECK(before->provenance == DatasetProvenance());
  CHECK(fixture.CacheCount() == 2);
  // The same rows of another environment are another dataset, with noise of its own.
  provenance.environment = "Walker2d";
  REQUIRE(
      WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data, provenance).ok());
  const auto other = fixture.OpenMade("obs-noise=1");
  REQUIRE(other.ok());
  CHECK(other->environment == "Walker2d");
  CHECK(other->fingerprint != before->fingerprint);
  CHECK(other->dataset->columns().observations[0] != before->dataset->columns().observations[0]);
}

TEST_CASE("the seed counts where numbers are drawn, and nowhere else") {
  const StoreFixture fixture;
  CHECK(fixture.OpenMade("obs-noise=1", 0)->fingerprint !=
        fixture.OpenMade("obs-noise=1", 1)->fingerprint);
  CHECK(fixture.OpenMade("obs-noise=1", 1)->seed == 1);
  CHECK(fixture.OpenMade("hidden=9", 0)->fingerprint ==
        fixture.OpenMade("hidden=9", 1)->fingerprint);
  CHECK(fixture.OpenMade("hidden=9", 1)->seed == 0);
}

TEST_CASE("dimensions that the behaviour policy could not see are hidden with the corruption's") {
  const StoreFixture fixture;
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = {9, 12};
  const ExampleDataset data = Hiding({9, 12}, fixture.data);
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), data, provenance).ok());
  CHECK(fixture.OpenMade("")->hidden_dimensions == std::vector<uint32_t>{9, 12});
  CHECK(fixture.OpenMade("hidden=3+9")->hidden_dimensions == std::vector<uint32_t>{3, 9, 12});
}

TEST_CASE("hidden dimensions are 0 under noise, whoever hid them and in whichever order") {
  const StoreFixture fixture;
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = {12};
  const ExampleDataset data = Hiding({12}, fixture.data);
  REQUIRE(WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), data, provenance).ok());
  const auto opened = fixture.OpenMade("hidden=3,obs-noise=1");
  CHECK(opened->hidden_dimensions == std::vector<uint32_t>{3, 12});
  const TransitionColumns& columns = opened->dataset->columns();
  for (const auto& observations : {columns.observations, columns.next_observations}) {
    for (uint64_t row = 0; row < columns.rows; ++row) {
      const auto values = observations.subspan(row * columns.observation_size);
      REQUIRE(values[3] == 0);
      REQUIRE(values[12] == 0);
      REQUIRE(values[4] != fixture.data.observations[row * columns.observation_size + 4]);
    }
  }
}

TEST_CASE("a file without time-outs is refused where episodes end after other steps") {
  const StoreFixture fixture;
  DatasetStore store = fixture.Store();
  const auto open = [&](const std::string& name, uint64_t observation, uint64_t action) {
    fs::create_directories(fs::path(fixture.folder.File(name)).parent_path());
    auto file = Hdf5Writer::Create(fixture.folder.File(name + ".h5"));
    REQUIRE(file.ok());
    const std::vector<float> zeros(40 * observation);
    for (const auto& [column, width] :
         {std::pair{"observations", observation}, std::pair{"next_observations", observation},
          std::pair{"actions", action}, std::pair{"rewards", uint64_t{1}}}) {
      const auto id = file->CreateColumn(column, {Hdf5Type::kFloat32, width});
      REQUIRE(id.ok());
      REQUIRE(file->Append(*id, std::span(zeros).first(40 * width)).ok());
    }
    const auto id = file->CreateColumn("terminals", {Hdf5Type::kBool, 0});
    REQUIRE(id.ok());
    REQUIRE(file->Append(*id, std::vector<uint8_t>(40)).ok());
    REQUIRE(file->Commit().ok());
    return fixture.OpenMade(store, {name, {}, 0, TransitionRule::kStored, ""}).status();
  };
  CHECK(open("HalfCheetah/other", 17, 6).ok());
  CHECK(open("Mine/first", 25, 2).ok());  // of which nobody knows the limit
  const Status refused = open("Highway/first", 25, 2);
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("'timeouts'") && Catch::Contains("after 30"));
}

TEST_CASE("data of another environment is refused by name, and of an unknown one by size") {
  const StoreFixture fixture;
  fs::create_directory(fixture.folder.File("Mine"));
  REQUIRE(WriteExample(fixture.folder.File("Mine/first.h5"), fixture.data).ok());
  DatasetStore store = fixture.Store();
  const auto open = [&](const std::string& name, const std::string& environment) {
    return fixture.OpenMade(store, {name, {}, 0, TransitionRule::kStored, environment}).status();
  };
  CHECK(open("HalfCheetah/medium", "HalfCheetah").ok());
  const Status refused = open("HalfCheetah/medium", "Walker2d");  // of equal sizes
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("HalfCheetah/medium was recorded in HalfCheetah"));
  CHECK(open("Mine/first", "Walker2d").ok());
  CHECK(open("Mine/first", "Hopper").code() == StatusCode::kInvalidArgument);
  CHECK(open("Mine/first", "Swimmer").code() == StatusCode::kUnknownName);
}

TEST_CASE("a file that was imported for another version of its environment is imported again") {
  const StoreFixture fixture;
  const auto now = fixture.OpenMade("");
  REQUIRE(now.ok());
  const std::string earlier = ImportedFingerprint("HalfCheetah-v77", now->info.columns_sha256,
                                                  now->dataset->cache().properties());
  REQUIRE(earlier != now->fingerprint);
  fs::rename(fixture.folder.File(".b4mrl-cache/" + now->fingerprint),
             fixture.folder.File(".b4mrl-cache/" + earlier));
  const std::string entry = fixture.folder.File(
      ".b4mrl-cache/index/" + DatasetIndex::KeyOf("HalfCheetah/medium") + ".json");
  nlohmann::json json = nlohmann::json::parse(ReadBytes(entry), nullptr, false);
  json["fingerprint"] = earlier;
  WriteBytes(entry, json.dump());
  const auto again = fixture.OpenMade("");
  REQUIRE(again.ok());
  CHECK(again->fingerprint == now->fingerprint);
}

TEST_CASE("an entry of the index that nests lists without limit is no entry") {
  const TemporaryFolder folder;
  const DatasetIndex index(folder.path());
  const FileIdentity file{1, 2, 3};
  ImportedFile imported{file, "", "", std::string(32, 'a'), {7, "", {}}};
  imported.contents.provenance.environment = "HalfCheetah";
  imported.contents.provenance.parts = {{"SAC", "ab", 3, 7}};
  REQUIRE(index.Add("x", imported).ok());
  REQUIRE(index.Find("x", file));
  const std::string entry = folder.File(DatasetIndex::KeyOf("x") + ".json");
  std::string text = ReadBytes(entry);
  text.insert(1, "\"more\": " + std::string(1000, '[') + std::string(1000, ']') + ", ");
  WriteBytes(entry, text);
  CHECK_FALSE(index.Find("x", file));
}

// The example without next_observations, as D4RL's first version has it.
void WriteWithoutNext(const std::string& path, const ExampleDataset& data) {
  auto file = Hdf5Writer::Create(path);
  REQUIRE(file.ok());
  const auto add = [&](const char* name, Hdf5Type type, uint64_t width, const auto& values) {
    const auto column = file->CreateColumn(name, {type, width, 64, 1});
    REQUIRE(column.ok());
    REQUIRE(file->Append(*column, std::span(values)).ok());
  };
  add("observations", Hdf5Type::kFloat32, data.observation_size, data.observations);
  add("actions", Hdf5Type::kFloat32, data.action_size, data.actions);
  add("rewards", Hdf5Type::kFloat32, 0, data.rewards);
  add("terminals", Hdf5Type::kBool, 0, data.terminals);
  add("timeouts", Hdf5Type::kBool, 0, data.timeouts);
  REQUIRE(file->Commit().ok());
}

TEST_CASE("returns are those of the file's episodes under every rule and corruption") {
  const StoreFixture fixture;
  const DatasetStatistics whole = fixture.OpenMade("")->dataset->statistics();
  REQUIRE(std::isfinite(whole.mean_return));
  const auto check = [&](const std::string& corruptions, TransitionRule rule) {
    CAPTURE(corruptions, TransitionRuleName(rule));
    DatasetStore store = fixture.Store();
    DatasetRequest request = StoreFixture::Request(corruptions);
    request.rule = rule;
    const auto opened = StoreFixture::OpenMade(store, request);
    REQUIRE(opened.ok());
    const DatasetStatistics& statistics = opened->dataset->statistics();
    CHECK(statistics.mean_return == whole.mean_return);
    CHECK(statistics.std_return == whole.std_return);
    CHECK(statistics.max_reward == whole.max_reward);
    CHECK(statistics.episodes == whole.episodes);
  };
  check("", TransitionRule::kD4rl);
  check("obs-noise=1", TransitionRule::kD4rl);
  WriteWithoutNext(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data);
  check("", TransitionRule::kStored);
  check("obs-noise=1", TransitionRule::kStored);
  check("hidden=9", TransitionRule::kD4rl);
}

TEST_CASE("an environment that a file names with Gymnasium's version is that environment") {
  const StoreFixture fixture;
  const auto open = [&](const std::string& environment) {
    DatasetProvenance provenance;
    provenance.environment = environment;
    REQUIRE(
        WriteExample(fixture.folder.File("HalfCheetah/medium.h5"), fixture.data, provenance).ok());
    const auto opened = fixture.OpenMade("");
    REQUIRE(opened.ok());
    return opened->environment;
  };
  CHECK(open("HalfCheetah-v4") == "HalfCheetah");
  CHECK(open("Walker2d-v5") == "Walker2d");
  CHECK(open("Swimmer-v4") == "Swimmer-v4");
  CHECK(open("HalfCheetah-vx") == "HalfCheetah-vx");
}

}  // namespace
}  // namespace b4mrl
