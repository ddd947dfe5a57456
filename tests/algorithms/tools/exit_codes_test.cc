// What is at fault decides the exit code: an option, a file, another process or the daemon.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "data/d4rl/dataset_file_reader.h"
#include "data/files/atomic_file.h"
#include "tests/algorithms/tools/dataset_commands.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

const std::string kAgents = B4MRL_SOURCE_DIR "/data/agents/";

void CheckEnd(const Outcome& outcome, int exit_code, const std::string& words) {
  INFO(outcome.err);
  CHECK(outcome.exit_code == exit_code);
  CHECK(Says(outcome.err, words));
}

TEST_CASE("Perturbations that cannot be read are a wrong option of every command") {
  const DatasetCommands folders;
  const std::vector<Words> commands = {
      {"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--out",
       folders.folder.File("run"), "--simulator"},
      {"train", "--algorithm", "sac", "--environment", "HalfCheetah", "--out",
       folders.folder.File("run"), "--world"},
      {"train", "--algorithm", "bc", "--environment", "HalfCheetah", "--out",
       folders.folder.File("run"), "--dataset", "HalfCheetah/medium", "--corruption"},
      {"dataset", "make", "HalfCheetah/random", "--data", folders.folder.File("data"),
       "--simulator"},
      {"dataset", "info", "HalfCheetah/random", "--corruption"},
      {"evaluate", "--agent", kAgents + "halfcheetah-medium.h5", "--simulator"}};
  for (Words words : commands) {
    words.emplace_back("gravity=");
    CheckEnd(Run(words), 2, "'gravity=', allowed: name or name=argument");
  }
  CHECK_FALSE(fs::exists(folders.folder.File("run")));
  CHECK_FALSE(fs::exists(folders.folder.File("data")));
}

TEST_CASE("More rows than a run has are a wrong option, and an agent that does not fit is input") {
  const DatasetCommands folders;
  CheckEnd(folders.Dataset({"make", "HalfCheetah/medium-replay", "--rows", "1e8"}), 2,
           "--rows is 100000000, allowed: 1..");
  const std::string no_agent = folders.folder.File("rows.h5");
  RequireOk(WriteExample(no_agent, MakeExampleDataset({5}, 17, 6)));
  CheckEnd(folders.Dataset({"make", "HalfCheetah/mine", "--agent", no_agent}), 3, no_agent);
  CHECK_FALSE(fs::exists(folders.folder.File("data")));  // no daemon was asked
  CheckEnd(folders.Dataset({"make", "HalfCheetah/mine", "--agent", kAgents + "hopper-expert.h5"}),
           3, "the agent has 11 observation and 3 action values");
  CheckEnd(folders.Dataset({"make", "HalfCheeta/mine", "--agent", kAgents + "hopper-expert.h5"}), 5,
           "did you mean 'HalfCheetah'");
}

TEST_CASE("An export that finds another process writing its file is told so by its code") {
  const DatasetCommands folders;
  REQUIRE(folders.Dataset({"make", "Hopper/random", "--rows", "500"}).exit_code == 0);
  const std::string file = folders.folder.File("out.h5");
  const AtomicFile other = Take(AtomicFile::Create(file));
  CheckEnd(folders.Dataset({"export", "Hopper/random", file}), 6, "another process is writing");
}

TEST_CASE("More episodes than Minari takes are wrong input") {
  const DatasetCommands folders;
  fs::create_directories(folders.folder.File("data/Mine"));
  RequireOk(WriteExample(folders.folder.File("data/Mine/short.h5"),
                         MakeExampleDataset(std::vector<size_t>(1'000'001, 1), 1, 1)));
  const std::string root = folders.folder.File("minari");
  CheckEnd(folders.Dataset({"export", "Mine/short", root, "--format", "minari"}), 3, "episodes");
  CHECK_FALSE(fs::exists(root));
}

TEST_CASE("A recording that contradicts itself is wrong input") {
  const DatasetCommands folders;
  fs::create_directories(folders.folder.File("data"));
  DatasetProvenance provenance;
  provenance.environment = "HalfCheetah";
  provenance.parts = {{.policy = "any", .policy_sha256 = "", .seed = 0, .rows = 5}};
  const std::string file = folders.folder.File("rows.h5");
  RequireOk(WriteExample(file, MakeExampleDataset({7}, 17, 6), provenance));
  CheckEnd(folders.Dataset({"verify", file}), 3, "seeds of 5 of its 7 rows");
  RequireOk(WriteExample(file, MakeExampleDataset({5}, 11, 3), provenance));
  CheckEnd(folders.Dataset({"verify", file}), 3, "the file has 11 observation and 3 action values");
  provenance.environment = "HalfCheeta";
  RequireOk(WriteExample(file, MakeExampleDataset({5}, 17, 6), provenance));
  CheckEnd(folders.Dataset({"verify", file}), 3, "did you mean 'HalfCheetah'");
}

}  // namespace
}  // namespace b4mrl
