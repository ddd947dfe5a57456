// Exports to files of other programs, and Minari's folders on their way back.
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/algorithms/tools/dataset_commands.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

struct Exports : DatasetCommands {
  void Make(const std::string& name, const std::string& rows) const {
    REQUIRE(Dataset({"make", name, "--rows", rows}).exit_code == 0);
  }
  std::string Root() const { return folder.File("minari"); }
};

TEST_CASE("A dataset comes back from Minari's folder with equal columns and provenance") {
  const Exports exports;
  exports.Make("Hopper/random", "700");  // episodes of some 20 rows, the last one unfinished
  REQUIRE(exports.Dataset({"export", "Hopper/random", exports.Root(), "--format", "minari"})
              .exit_code == 0);
  const std::string exported = exports.Root() + "/b4mrl/Hopper/random-v0";
  REQUIRE(exports.Dataset({"import", exported, "--name", "Hopper/back"}).exit_code == 0);
  const auto original = exports.Info("Hopper/random"), back = exports.Info("Hopper/back");
  for (const char* key : {"columns_sha256", "episodes", "environment", "behaviour_policy", "recipe",
                          "engine", "license"}) {
    INFO(key);
    CHECK(original[key] == back[key]);
  }
  CHECK(ReadBytes(exports.Root() + "/b4mrl/namespace_metadata.json") == "{}");
}

TEST_CASE("Hidden dimensions stay hidden on the way through Minari, and the id tells of them") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1500");
  REQUIRE(exports
              .Dataset({"export", "HalfCheetah/random", exports.Root(), "--format", "minari",
                        "--corruption", "hidden=9,obs-noise=0.05", "--corruption-seed", "3"})
              .exit_code == 0);
  const std::string exported =
      exports.Root() + "/b4mrl/HalfCheetah/random_obs-noise-0p05_hidden-9_seed-3-v0/data";
  REQUIRE(exports.Dataset({"import", exported, "--name", "HalfCheetah/back"}).exit_code == 0);
  const auto back = exports.Info("HalfCheetah/back");
  CHECK(back["hidden_dimensions"] == std::vector<int>{9});
  CHECK_THAT(back["recipe"].get<std::string>(),
             Catch::EndsWith("; served from HalfCheetah/random-v0 with obs-noise=0.05,hidden=9, "
                             "seed 3"));
  const auto served = exports.Info(
      "HalfCheetah/random", {"--corruption", "hidden=9,obs-noise=0.05", "--corruption-seed", "3"});
  CHECK(back["observation_mean"] == served["observation_mean"]);
  CHECK(back["observation_std"] == served["observation_std"]);
}

TEST_CASE(
    "A seed that no corruption draws from is refused, as two seeds would seem to be two draws") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  for (const Words& corruption : {Words(), Words{"--corruption", "hidden=9"}}) {
    Words words = {"info", "HalfCheetah/random", "--corruption-seed", "3"};
    words.insert(words.end(), corruption.begin(), corruption.end());
    const Outcome outcome = exports.Dataset(words);
    CHECK(outcome.exit_code == 2);
    CHECK_THAT(outcome.err, Catch::Contains("--corruption-seed is 3"));
  }
}

TEST_CASE("A Minari dataset is not replaced, and only ids that Minari reads are taken") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  const Words words = {"export", "HalfCheetah/random", exports.Root(), "--format", "minari"};
  const auto with_id = [&](const std::string& id) {
    Words more = words;
    more.insert(more.end(), {"--id", id});
    return exports.Dataset(more).exit_code;
  };
  CHECK(with_id("mine/run-v3") == 0);
  CHECK(fs::exists(exports.Root() + "/mine/run-v3/data/metadata.json"));
  CHECK(with_id("mine/run-v3") == 3);
  CHECK(with_id("mine/run") == 2);
  CHECK(with_id("../run-v0") == 2);
  CHECK(exports
            .Dataset({"export", "HalfCheetah/random", exports.folder.File("x.csv"), "--format",
                      "csv", "--id", "a-v0"})
            .exit_code == 2);
  CHECK_FALSE(fs::exists(exports.folder.File("x.csv")));
}

TEST_CASE("An export replaces a file only when told to, even that of the dataset itself") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  const std::string own = exports.folder.File("data/HalfCheetah/random-v0.h5");
  const std::string before = ReadBytes(own);
  for (const char* format : {"d4rl", "csv"}) {
    const Words words = {"export", "HalfCheetah/random", own, "--format", format};
    const Outcome refused = exports.Dataset(words);
    CHECK(refused.exit_code == 3);
    CHECK_THAT(refused.err, Catch::Contains("--replace"));
  }
  CHECK((ReadBytes(own) == before));
  const std::string other = exports.folder.File("x.h5");
  WriteBytes(other, "text");
  CHECK(exports.Dataset({"export", "HalfCheetah/random", other, "--replace"}).exit_code == 0);
  CHECK(fs::file_size(other) > 1000);
}

TEST_CASE(
    "Minari's data have our contributors as author if we recorded them, whatever the licence") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  DatasetProvenance foreign;
  foreign.environment = "HalfCheetah";
  foreign.license = "CC0-1.0";
  REQUIRE(WriteExample(exports.folder.File("data/HalfCheetah/foreign.h5"),
                       MakeExampleDataset({30}, 17, 6), foreign)
              .ok());
  const auto has_author = [&](const std::string& name, const std::string& id) {
    REQUIRE(exports.Dataset({"export", name, exports.Root(), "--format", "minari", "--id", id})
                .exit_code == 0);
    return nlohmann::json::parse(ReadBytes(exports.Root() + "/" + id + "/data/metadata.json"),
                                 nullptr, false)
        .contains("author");
  };
  CHECK(has_author("HalfCheetah/random", "ours-v0"));
  CHECK_FALSE(has_author("HalfCheetah/foreign", "theirs-v0"));
}

TEST_CASE("Rows that Minari cannot hold are refused by number, and nothing is written") {
  const Exports exports;
  ExampleDataset data = MakeExampleDataset({30, 20}, 5, 2);
  data.next_observations[41 * 5] += 1;
  fs::create_directories(exports.folder.File("data/Mine"));
  REQUIRE(WriteExample(exports.folder.File("data/Mine/x.h5"), data).ok());
  const Outcome refused =
      exports.Dataset({"export", "Mine/x", exports.Root(), "--format", "minari"});
  CHECK(refused.exit_code == 3);
  CHECK_THAT(refused.err, Catch::Contains("row 41"));
  CHECK_FALSE(fs::exists(exports.Root()));
  CHECK(exports.Dataset({"export", "Mine/x", exports.folder.File("x.csv"), "--format", "csv"})
            .exit_code == 0);
  CHECK(fs::file_size(exports.folder.File("x.csv")) > 50 * 13 * 2);
}

TEST_CASE("Data of an unknown environment go to Minari without one, as a box without bounds") {
  const Exports exports;
  fs::create_directories(exports.folder.File("data/Mine"));
  REQUIRE(WriteExample(exports.folder.File("data/Mine/x.h5"), MakeExampleDataset({30}, 5, 2)).ok());
  REQUIRE(exports.Dataset({"export", "Mine/x", exports.Root(), "--format", "minari"}).exit_code ==
          0);
  const auto metadata = nlohmann::json::parse(
      ReadBytes(exports.Root() + "/b4mrl/Mine/x-v0/data/metadata.json"), nullptr, false);
  CHECK_FALSE(metadata.contains("env_spec"));
  CHECK_FALSE(metadata.contains("ref_min_score"));
  CHECK_THAT(metadata["action_space"].get<std::string>(),
             Catch::Contains("[2], \"low\": [-Infinity, -Infinity]"));
}

TEST_CASE("How the rows of an unknown environment were made is told after the way through Minari") {
  const Exports exports;
  fs::create_directories(exports.folder.File("data/Mine"));
  DatasetProvenance provenance;
  provenance.recipe = "drawn by hand";
  REQUIRE(WriteExample(exports.folder.File("data/Mine/x.h5"), MakeExampleDataset({30}, 5, 2),
                       provenance)
              .ok());
  REQUIRE(exports.Dataset({"export", "Mine/x", exports.Root(), "--format", "minari"}).exit_code ==
          0);
  REQUIRE(exports.Dataset({"import", exports.Root() + "/b4mrl/Mine/x-v0", "--name", "Mine/back"})
              .exit_code == 0);
  CHECK(exports.Info("Mine/back")["recipe"] == "drawn by hand");
}

TEST_CASE("Minari's data of a Gymnasium task belong to the daemon's task if the sizes are equal") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  REQUIRE(exports
              .Dataset({"export", "HalfCheetah/random", exports.Root(), "--format", "minari",
                        "--id", "x-v0"})
              .exit_code == 0);
  const std::string path = exports.Root() + "/x-v0/data/metadata.json";
  auto metadata = nlohmann::json::parse(ReadBytes(path));
  metadata.erase("b4mrl");
  const auto import = [&](const std::string& gymnasium_id, const std::string& name) {
    metadata["env_spec"] =
        nlohmann::json{{"id", gymnasium_id}, {"kwargs", {{"reset_noise_scale", 0.2}}}}.dump();
    WriteBytes(path, metadata.dump());
    return exports.Dataset({"import", exports.Root() + "/x-v0", "--name", name});
  };
  const Outcome imported = import("HalfCheetah-v5", "mine/cheetah");
  CHECK(imported.exit_code == 0);
  CHECK_THAT(imported.err, Catch::Contains("the daemon's HalfCheetah is v4"));
  const auto info = exports.Info("mine/cheetah");
  CHECK(info["environment"] == "HalfCheetah");
  CHECK(info["environment_from"] == "the file");
  CHECK(info["recipe"] ==
        "Minari's dataset x-v0, recorded in Gymnasium's HalfCheetah-v5; the environment's "
        "arguments were {\"reset_noise_scale\":0.2}");
  CHECK_THAT(import("HalfCheetah-v4", "mine/v4").err, !Catch::Contains("is v4"));
  CHECK(import("Hopper-v4", "mine/hopper").exit_code == 0);  // but Hopper has other sizes
  CHECK(exports.Info("mine/hopper")["environment"] == "");
  // Under Hopper's own name the daemon would never serve it.
  CHECK(import("Hopper-v4", "Hopper/mine").exit_code == 3);
  CHECK_FALSE(fs::exists(exports.folder.File("data/Hopper/mine.h5")));
}

TEST_CASE("A damaged or foreign Minari folder is refused and leaves no dataset") {
  const Exports exports;
  exports.Make("HalfCheetah/random", "1000");
  REQUIRE(exports
              .Dataset({"export", "HalfCheetah/random", exports.Root(), "--format", "minari",
                        "--id", "x-v0"})
              .exit_code == 0);
  const std::string data = exports.Root() + "/x-v0/data";
  const auto refused = [&](const std::string& words) {
    const Outcome outcome =
        exports.Dataset({"import", exports.Root() + "/x-v0", "--name", "Hopper/back"});
    CHECK(outcome.exit_code == 3);
    CHECK_THAT(outcome.err, Catch::Contains(words));
    CHECK_FALSE(fs::exists(exports.folder.File("data/Hopper/back.h5")));
  };
  const std::string metadata = ReadBytes(data + "/metadata.json");
  WriteBytes(data + "/metadata.json", "{");
  refused("metadata.json");
  auto changed = nlohmann::json::parse(metadata);
  changed["action_space"] = R"({"type": "Discrete", "n": 4, "start": 0})";
  WriteBytes(data + "/metadata.json", changed.dump());
  refused("a Box");
  WriteBytes(data + "/metadata.json", metadata);
  fs::resize_file(data + "/main_data.hdf5", 3000);
  refused("main_data.hdf5");
  fs::remove_all(data);
  refused("data/metadata.json");
}

}  // namespace
}  // namespace b4mrl
