// What `b4mrl dataset import` takes, and what comes back from files that `export` wrote.
#include <sys/stat.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/algorithms/tools/dataset_commands.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

TEST_CASE("Rows that were exported by D4RL's rule come back under it") {
  const DatasetCommands imports;
  REQUIRE(imports.Dataset({"make", "Hopper/random", "--rows", "1500"}).exit_code == 0);
  const bool as_minari = GENERATE(false, true);
  INFO(as_minari);
  const std::string target = imports.folder.File(as_minari ? "minari" : "rows.h5");
  const Outcome exported = imports.Dataset({"export", "Hopper/random", target, "--transitions",
                                            "d4rl", "--format", as_minari ? "minari" : "d4rl"});
  INFO(exported.err);
  REQUIRE(exported.exit_code == 0);
  const std::string id = as_minari ? "/b4mrl/Hopper/random_d4rl-transitions-v0" : "";
  const Outcome imported = imports.Dataset({"import", target + id, "--name", "Hopper/back"});
  INFO(imported.err);
  REQUIRE(imported.exit_code == 0);
  const auto back = imports.Info("Hopper/back"), original = imports.Info("Hopper/random");
  CHECK(original["transitions"] == "stored");
  CHECK(back["transitions"] == "d4rl");
  CHECK(back["behaviour_policy"] == original["behaviour_policy"]);
  CHECK(back["rows"] < original["rows"]);
  // A second application would drop rows again.
  const Outcome again = imports.Dataset({"info", "Hopper/back", "--json", "--transitions", "d4rl"});
  CHECK(nlohmann::json::parse(again.out, nullptr, false)["rows"] == back["rows"]);
}

TEST_CASE("An import says how many rows are not finite, or have actions out of bounds") {
  const DatasetCommands imports;
  ExampleDataset data = MakeExampleDataset({50, 50}, 17, 6);
  for (float& action : data.actions) action = std::clamp(action, -1.0F, 1.0F);
  const std::string file = imports.folder.File("rows.h5");
  REQUIRE(WriteExample(file, data).ok());
  const Outcome sound = imports.Dataset({"import", file, "--name", "HalfCheetah/sound"});
  CHECK(sound.exit_code == 0);
  CHECK_THAT(sound.err, !Catch::Contains(" rows "));
  for (const size_t row : {3, 7, 8}) data.rewards[row] = std::nanf("");
  data.actions[6 * 20] = 1.5;
  data.actions[6 * 20 + 5] = -1.5;
  REQUIRE(WriteExample(file, data).ok());
  const Outcome odd = imports.Dataset({"import", file, "--name", "HalfCheetah/odd"});
  CHECK(odd.exit_code == 0);
  CHECK_THAT(odd.err, Catch::Contains("3 of 100 rows hold a NaN or an infinity"));
  CHECK_THAT(odd.err, Catch::Contains("1 of 100 rows have actions outside of HalfCheetah's"));
}

TEST_CASE("What is no regular file is refused, and holes stay holes") {
  const DatasetCommands imports;
  const std::string pipe = imports.folder.File("pipe.h5");
  REQUIRE(mkfifo(pipe.c_str(), 0600) == 0);
  for (const std::string& file : {pipe, std::string("/dev/zero")}) {
    const Outcome refused = imports.Dataset({"import", file, "--name", "HalfCheetah/mine"});
    CHECK(refused.exit_code == 3);
    CHECK_THAT(refused.err, Catch::Contains(file) && Catch::Contains("a regular file"));
  }
  const std::string sparse = imports.folder.File("sparse.h5");
  REQUIRE(WriteExample(sparse, MakeExampleDataset({700, 300}, 17, 6)).ok());
  constexpr off_t kBytes = 1 << 30;
  fs::resize_file(sparse, kBytes);
  REQUIRE(imports.Dataset({"import", sparse, "--name", "HalfCheetah/mine"}).exit_code == 0);
  struct stat copied {};
  REQUIRE(stat(imports.folder.File("data/HalfCheetah/mine.h5").c_str(), &copied) == 0);
  CHECK(copied.st_size == kBytes);
  CHECK(copied.st_blocks * 512 < kBytes / 100);
}

TEST_CASE("An import cannot take the place of a dataset that the project publishes") {
  const DatasetCommands imports;
  const std::string file = imports.folder.File("own.h5");
  REQUIRE(WriteExample(file, MakeExampleDataset({700, 300}, 17, 6)).ok());
  for (const char* name :
       {"HalfCheetah/medium", "HalfCheetah/medium-v0", "HalfCheetah/medium-v7"}) {
    const Outcome refused = imports.Dataset({"import", file, "--name", name});
    INFO(refused.err);
    CHECK(refused.exit_code == 3);
    CHECK_THAT(refused.err, Catch::Contains(name) && Catch::Contains("`b4mrl dataset make` makes"));
    CHECK_FALSE(fs::exists(imports.folder.File("data/HalfCheetah")));
  }
}

TEST_CASE("A name that is nearly an environment's, or not that of the file's own, is refused") {
  const DatasetCommands imports;
  REQUIRE(imports.Dataset({"make", "HalfCheetah/random", "--rows", "1500"}).exit_code == 0);
  const std::string file = imports.folder.File("data/HalfCheetah/random-v0.h5");
  const Outcome misspelt = imports.Dataset({"import", file, "--name", "halfcheetah/mine"});
  CHECK(misspelt.exit_code == 5);
  CHECK_THAT(misspelt.err,
             Catch::Contains("unknown environment 'halfcheetah'; did you mean 'HalfCheetah'?"));
  CHECK_FALSE(fs::exists(imports.folder.File("data/halfcheetah")));
  // Walker2d's rows have the same sizes.
  const Outcome other = imports.Dataset({"import", file, "--name", "Walker2d/mine"});
  CHECK(other.exit_code == 3);
  CHECK_THAT(other.err, Catch::Contains("Walker2d/mine") && Catch::Contains("HalfCheetah"));
  CHECK_FALSE(fs::exists(imports.folder.File("data/Walker2d")));
  // Of a foreign environment's name the file decides.
  CHECK(imports.Dataset({"import", file, "--name", "mine/cheetah"}).exit_code == 0);
  CHECK(imports.Info("mine/cheetah")["environment"] == "HalfCheetah");
}

TEST_CASE("A file of D4RL's that is there but is no dataset is not passed over") {
  const DatasetCommands imports;
  const std::string folder = imports.folder.File("d4rl");
  fs::create_directories(folder);
  fs::create_directories(imports.folder.File("data/d4rl"));
  const ExampleDataset data = MakeExampleDataset({700, 300}, 11, 3);
  REQUIRE(WriteExample(folder + "/hopper_medium-v2.hdf5", data).ok());
  const std::string present = imports.folder.File("data/d4rl/hopper-medium-v2.hdf5");
  WriteBytes(present, "no HDF5");
  const Outcome damaged = imports.Dataset({"import", "--d4rl", folder});
  CHECK(damaged.exit_code == 3);
  CHECK_THAT(damaged.err, Catch::Contains("d4rl/hopper-medium-v2: is there, but cannot be opened"));
  fs::remove(present);
  CHECK(imports.Dataset({"import", "--d4rl", folder}).exit_code == 0);
  const Outcome again = imports.Dataset({"import", "--d4rl", folder});
  CHECK(again.exit_code == 0);
  CHECK_THAT(again.err, Catch::Contains("d4rl/hopper-medium-v2: is there already"));
}

}  // namespace
}  // namespace b4mrl
