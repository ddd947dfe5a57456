// Datasets are made by their recipes, and files step again to the bit.
#include <catch2/catch.hpp>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "data/d4rl/dataset_file_reader.h"
#include "data/d4rl/dataset_file_writer.h"
#include "data/files/atomic_file.h"
#include "tests/algorithms/tools/folder_watch.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// Makes 2,500 rows of a dataset in `folder` and returns what the command prints.
nlohmann::json Make(const TemporaryFolder& folder, const std::string& name) {
  const Outcome made = Run(
      {"dataset", "make", name, "--rows", "2500", "--data", folder.path(), "--quiet", "--json"});
  INFO(made.err);
  REQUIRE(made.exit_code == 0);
  return nlohmann::json::parse(made.out, nullptr, false);
}

Outcome Verify(const std::string& file) {
  return Run({"dataset", "verify", file, "--quiet", "--json"});
}

TEST_CASE("Recordings of every kind step again to the bit") {
  const auto [name, parts] = GENERATE(
      std::pair{"HalfCheetah/random", 1u}, std::pair{"HalfCheetah/partial-low-history", 1u},
      std::pair{"HalfCheetah/medium-replay", 1u}, std::pair{"Hopper/medium-expert", 2u},
      std::pair{"Highway/medium", 1u});
  CAPTURE(name);
  const TemporaryFolder folder;
  const nlohmann::json made = Make(folder, name);
  CHECK(made["name"] == std::string(name) + "-v0");
  CHECK(made["seeds"].size() == parts);
  CHECK(Says(made["verdict"], "not the published dataset"));
  const Outcome verified = Verify(made["file"]);
  INFO(verified.err);
  CHECK(verified.exit_code == 0);
  CHECK(nlohmann::json::parse(verified.out)["equal_rows"] == made["rows"]);
}

TEST_CASE("Where no episode fits into the first half, a concatenation is all by its second agent") {
  const TemporaryFolder folder;
  const Outcome made = Run({"dataset", "make", "HalfCheetah/medium-expert", "--rows", "1", "--data",
                            folder.path(), "--quiet", "--json"});
  INFO(made.err);
  REQUIRE(made.exit_code == 0);
  const nlohmann::json json = nlohmann::json::parse(made.out, nullptr, false);
  CHECK(json["rows"] == 1);
  CHECK(json["seeds"] == nlohmann::json{"1"});
  CHECK(json["episodes"] == 0);
  CHECK(json["mean_return"].is_null());
  CHECK(Verify(json["file"]).exit_code == 0);
}

// A file of others: 50 rows of HalfCheetah with the states that its observations tell, changed.
void WriteForeignFile(const DatasetFileReader& source, const std::string& path,
                      const std::function<void(DatasetBlock&)>& change) {
  DatasetBlock rows = Take(source.Read(0, 50));
  for (size_t i = 0; i < 50; ++i) {
    const float* observation = rows.observations.data() + i * 17;  // without the root's x
    rows.qpos.push_back(0);
    rows.qpos.insert(rows.qpos.end(), observation, observation + 8);
    rows.qvel.insert(rows.qvel.end(), observation + 8, observation + 17);
  }
  change(rows);
  DatasetWriter writer = Take(DatasetWriter::Create(path, {.observation_dimensions = 17,
                                                           .action_dimensions = 6,
                                                           .qpos_dimensions = 9,
                                                           .qvel_dimensions = 9}));
  RequireOk(writer.Append(rows.view()));
  RequireOk(writer.Commit());
}

TEST_CASE(
    "Rows of other programs are stepped from their states, and a NaN is no small difference") {
  const TemporaryFolder folder;
  const nlohmann::json made = Make(folder, "HalfCheetah/medium");
  const DatasetFileReader source = Take(DatasetFileReader::Open(made["file"]));
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  const auto verify = [&](const std::function<void(DatasetBlock&)>& change) {
    WriteForeignFile(source, folder.File("other.h5"), change);
    return Run({"dataset", "verify", folder.File("other.h5"), "--environment", "HalfCheetah",
                "--quiet", "--json"});
  };
  const Outcome refused = verify([](DatasetBlock& rows) { rows.qpos[7 * 9] = kNaN; });
  CHECK(refused.exit_code != 0);
  CHECK(Says(refused.err, "states of the rows 0 to 49, one a lane: lane 7: state qpos[0] is nan"));
  const Outcome outcome =
      verify([](DatasetBlock& rows) { rows.next_observations[31 * 17 + 4] = kNaN; });
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
  const nlohmann::json compared = nlohmann::json::parse(outcome.out, nullptr, false);
  CHECK(compared["rows"] == 50);
  CHECK(compared["failed_rows"] == 0);
  CHECK(compared["observations"]["largest"] == 0);
  // States that are rounded to float32 move a step by some millionths, seldom by thousandths.
  CHECK(compared["next_observations"]["median"] < 1e-4);
  CHECK(compared["rewards"]["largest"] < 1e-2);
  CHECK(compared["next_observations"]["largest"].is_null());  // JSON has no infinity
  CHECK(compared["next_observations"]["largest_row"] == 31);
}

TEST_CASE("A dataset that was recorded with a hidden dimension holds zeros there") {
  const TemporaryFolder folder;
  const nlohmann::json made = Make(folder, "HalfCheetah/partial-high");
  const DatasetFileReader file = Take(DatasetFileReader::Open(made["file"]));
  CHECK(file.provenance().hidden_dimensions == std::vector<uint32_t>{9});
  CHECK(file.provenance().simulator == "hidden=9");
  const DatasetBlock rows = Take(file.Read(0, file.rows()));
  for (size_t row = 0; row < file.rows(); ++row) {
    REQUIRE(rows.observations[row * 17 + 9] == 0);
    REQUIRE(rows.next_observations[row * 17 + 9] == 0);
  }
}

TEST_CASE("A file with a changed action does not verify, and the error names its row") {
  const TemporaryFolder folder;
  const nlohmann::json made = Make(folder, "HalfCheetah/medium");
  const DatasetFileReader file = Take(DatasetFileReader::Open(made["file"]));
  DatasetBlock rows = Take(file.Read(0, file.rows()));
  rows.actions[1234 * file.action_size()] *= 0.5f;
  DatasetWriterOptions options;
  options.observation_dimensions = file.observation_size();
  options.action_dimensions = file.action_size();
  DatasetWriter copy = Take(DatasetWriter::Create(folder.File("copy.h5"), options));
  RequireOk(copy.Append(rows.view()));
  RequireOk(copy.SetProvenance(file.provenance()));
  RequireOk(copy.Commit());
  const Outcome verified = Verify(folder.File("copy.h5"));
  CHECK(verified.exit_code == 1);
  CHECK(Says(verified.err, "row 1234 of 2500 is the first that differs: next_observations["));
  CHECK(nlohmann::json::parse(verified.out)["equal_rows"] == 1234);
}

TEST_CASE("Making all datasets goes on after one that fails, and leaves those that are there") {
  const TemporaryFolder folder;
  const std::string obstacle = folder.File("Highway/random-v0.h5.b4mrl-tmp");
  std::filesystem::create_directories(obstacle);
  const auto make_all = [&] {
    return Run({"dataset", "make", "all", "--environment", "Highway", "--rows", "50", "--data",
                folder.path()});
  };
  const Outcome first = make_all();
  CHECK(first.exit_code == 3);
  CHECK(Says(first.err, "Highway/random-v0: cannot create"));
  CHECK(Says(first.out, "Highway/medium-v0: 50 rows"));
  std::filesystem::remove(obstacle);
  const Outcome second = make_all();
  CHECK(second.exit_code == 0);
  CHECK(Says(second.out, "Highway/random-v0: 50 rows"));
  CHECK(Says(second.err, "Highway/medium-v0: is there already"));
}

TEST_CASE("A dataset that another process makes is no failure of those that are all made") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.File("Highway"));
  const AtomicFile other = Take(AtomicFile::Create(folder.File("Highway/random-v0.h5")));
  const Outcome all = Run({"dataset", "make", "all", "--environment", "Highway", "--rows", "50",
                           "--data", folder.path()});
  CHECK(all.exit_code == 0);
  CHECK(Says(all.out, "Highway/medium-v0: 50 rows"));
  const Outcome one =
      Run({"dataset", "make", "Highway/random", "--rows", "50", "--data", folder.path()});
  CHECK(one.exit_code == 6);
}

TEST_CASE("A dataset that appears while it is made is no failure of those that are all made") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.File("Highway"));
  WriteBytes(folder.File("Highway/medium-v0.h5"), "there already");
  FolderWatch watch(folder.File("Highway"));
  Tool tool({"dataset", "make", "all", "--environment", "Highway", "--rows", "5e4", "--data",
             folder.path()});
  REQUIRE(watch.WaitFor("random-v0.h5.b4mrl-tmp"));
  WriteBytes(folder.File("Highway/random-v0.h5"), "of another process");
  const Outcome all = tool.Wait();
  INFO(all.err);
  CHECK(all.exit_code == 0);
  CHECK(Says(all.err, "appeared in the meantime and is kept"));
  CHECK(ReadBytes(folder.File("Highway/random-v0.h5")) == "of another process");
}

TEST_CASE("A dataset's name stands for its file, and its replay passes over earlier episodes") {
  const TemporaryFolder folder;
  Make(folder, "HalfCheetah/medium-replay");
  const Words verify = {"dataset", "verify", "HalfCheetah/medium-replay", "--data", folder.path()};
  const Outcome verified = Run(verify);
  INFO(verified.err);
  CHECK(verified.exit_code == 0);
  CHECK(Says(verified.out, folder.File("HalfCheetah/medium-replay-v0.h5") + ": all 2500 rows"));
  CHECK(Says(verified.err, "pass over earlier episodes: "));
  CHECK(Says(verified.err, "step again: 2500 rows"));
  const Outcome missing = Run({"dataset", "verify", "HalfCheetah/medium", "--data", folder.path()});
  CHECK(missing.exit_code == 5);
  CHECK(Says(missing.err, "`b4mrl dataset make HalfCheetah/medium` makes it"));
}

TEST_CASE("What a recipe cannot give is refused with the reason") {
  const TemporaryFolder folder;
  const auto refusal = [&](const Words& more) {
    Words words = {"dataset", "make", "--quiet", "--data", folder.path()};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = Run(words);
    CHECK(outcome.exit_code != 0);
    CHECK(outcome.out.empty());
    return outcome.err;
  };
  CHECK(Says(refusal({"HalfCheetah/action-delay"}), "no agent has reached the medium level"));
  CHECK(Says(refusal({"HalfCheetah/medum"}), "HalfCheetah/medium"));
  CHECK(Says(
      refusal({"HalfCheetah/mine", "--agent", B4MRL_SOURCE_DIR "/data/agents/hopper-expert.h5"}),
      "the agent has 11 observation and 3 action values, HalfCheetah has 17 and 6"));
  CHECK(Says(refusal({"Hopper/medium-replay", "--rows", "125001"}), "1..125000"));
  CHECK(Says(refusal({"Hopper/medium-replay", "--seed", "3"}), "--seed"));
  CHECK(Says(
      refusal({"Hopper/medium-v7", "--agent", B4MRL_SOURCE_DIR "/data/agents/hopper-medium.h5"}),
      "names other than Hopper/medium and its versions"));
  CHECK(Says(refusal({"all", "--environment", "Hoper"}),
             "did you mean 'Hopper'? known: HalfCheetah, Hopper, Walker2d, Highway"));
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("A run's files name the version of the dataset, and resuming need not") {
  const TemporaryFolder folder;
  Make(folder, "HalfCheetah/random");
  const auto train = [&](const char* updates) {
    const Outcome trained =
        Run({"train", "--algorithm", "bc", "--environment", "HalfCheetah", "--dataset",
             "HalfCheetah/random", "--updates", updates, "--eval-every", "5", "--eval-episodes",
             "1", "--quiet", "--resume", "--data", folder.path(), "--out", folder.File("run")});
    INFO(trained.err);
    CHECK(trained.exit_code == 0);
    const auto result =
        nlohmann::json::parse(ReadBytes(folder.File("run/result.json")), nullptr, false);
    CHECK(result["dataset"] == "HalfCheetah/random-v0");
    return result["updates"].get<int>();
  };
  CHECK(train("5") == 5);
  CHECK(train("10") == 10);
  CHECK(Says(ReadBytes(folder.File("run/config.toml")), "\"HalfCheetah/random-v0\""));
}

TEST_CASE("A learner is evaluated in the world that it is given") {
  const TemporaryFolder folder;
  Make(folder, "HalfCheetah/random");
  const auto returns = [&](const Words& world) {
    Words words = {"train",
                   "--algorithm",
                   "bc",
                   "--environment",
                   "HalfCheetah",
                   "--dataset",
                   "HalfCheetah/random",
                   "--updates",
                   "20",
                   "--eval-every",
                   "20",
                   "--eval-episodes",
                   "2",
                   "--quiet",
                   "--json",
                   "--data",
                   folder.path(),
                   "--out",
                   folder.File(world.empty() ? "true" : "world")};
    words.insert(words.end(), world.begin(), world.end());
    const Outcome trained = Run(words);
    INFO(trained.err);
    REQUIRE(trained.exit_code == 0);
    return nlohmann::json::parse(trained.out, nullptr, false)["returns"];
  };
  const nlohmann::json in_world = returns({"--world", "gravity=0.5"});
  CHECK(in_world != returns({}));
  const Outcome evaluated =
      Run({"evaluate", "--agent", folder.File("world/agent.h5"), "--environment", "HalfCheetah",
           "--simulator", "gravity=0.5", "--episodes", "2", "--json"});
  CHECK(nlohmann::json::parse(evaluated.out, nullptr, false)["returns"] == in_world);
  CHECK(evaluated.err.find("world") == std::string::npos);
  // Elsewhere its scores could be taken for those of its training.
  const Words elsewhere = {"evaluate", "--environment", "HalfCheetah", "--episodes", "1"};
  const auto said = [&](const std::string& agent, const Words& more) {
    Words words = elsewhere;
    words.insert(words.end(), {"--agent", folder.File(agent + "/agent.h5")});
    words.insert(words.end(), more.begin(), more.end());
    return Run(words).err;
  };
  CHECK(said("world", {})
            .find("trained for the world gravity=0.5, and is scored in the true "
                  "environment") != std::string::npos);
  CHECK(said("world", {"--simulator", "friction"}).find("scored in another one") !=
        std::string::npos);
  CHECK(said("true", {"--simulator", "gravity=0.5"}).find("world") == std::string::npos);
}

}  // namespace
}  // namespace b4mrl
