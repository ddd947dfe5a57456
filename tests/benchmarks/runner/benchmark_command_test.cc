// b4mrl benchmark trains each run once, whatever ends on the way.
#include <algorithm>
#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "data/files/atomic_file.h"
#include "tests/benchmarks/runner/suite.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Runs a command of the shell; its outputs are this program's.
int ExitCodeOf(const std::string& command) {
  return WEXITSTATUS(std::system(command.c_str()));  // NOLINT
}

TEST_CASE("A suite makes its data, trains each distinct run once and keeps the results") {
  const Suite suite;
  const Outcome listed = Run(suite.Command({"--dry-run"}));
  INFO(listed.err);
  CHECK(listed.exit_code == 0);
  CHECK(listed.out.find("0 of 4 cells filled") != std::string::npos);
  Words words = suite.Command();
  words[1] = "status";
  CHECK(Run(words).out == listed.out);
  CHECK_FALSE(fs::exists(suite.Out()));  // who looks makes nothing

  const Outcome first = Run(suite.Command());
  INFO(first.out << first.err);
  CHECK(first.exit_code == 0);
  CHECK(first.out.find("2 of 2 runs done") != std::string::npos);
  CHECK(Count(first.err, "make HalfCheetah/medium\n") == 1);
  const auto results = suite.Results();
  REQUIRE(results.size() == 2);
  for (const auto& [name, text] : results) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CHECK(json["finished"] == true);
    // Offline learners fill cells of benchmarks with whatever simulator.
    CHECK(json["benchmarks"].size() > 2);
    CHECK(json["curve"].size() == 2);
    CHECK(json["dataset"]["rows"] == 2000);
  }
  const Outcome again = Run(suite.Command());
  CHECK(again.exit_code == 0);
  CHECK(Count(again.err, "start ") == 0);
  CHECK(suite.Results() == results);
  const auto status =
      nlohmann::json::parse(Run(suite.Command({"--dry-run", "--json"})).out, nullptr, false);
  REQUIRE(status.size() == 2);
  for (const auto& run : status) {
    CHECK(run["done"] == true);
    CHECK(run["benchmarks"].size() == 2);
    CHECK(run["dataset"] == "HalfCheetah/medium-v0");
    CHECK(results.count(run["name"].get<std::string>() + "-" + run["id"].get<std::string>() +
                        ".json") == 1);
  }
}

TEST_CASE("Hidden cells are scored full as well, and noisy ones through their noise") {
  Suite suite("bc = 20");
  suite.pattern = "HalfCheetah/confounding/*-high+medium";
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  const auto results = suite.Results();
  REQUIRE(results.size() == 2);
  for (const auto& [name, text] : results) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    const bool hidden = json["corruption"] == "hidden-high";
    const auto& scorings = json["scorings"];
    CAPTURE(name, scorings.dump());
    REQUIRE(scorings.size() == 1);
    const auto& scoring = scorings[hidden ? "full" : "served"];
    CHECK(scoring["observe"] == (hidden ? "full" : "trained"));
    CHECK(scoring["simulator"] == (hidden ? "" : "obs-noise=0.05"));
    CHECK(scoring["returns"].size() == 1);
    CHECK(scoring["returns"] != json["returns"]);
    // b4mrl evaluate gives the same, from what the agent's file says of its training.
    const std::string run = fs::path(name).stem().string();
    const Outcome served =
        Run({"evaluate", "--agent",
             suite.Out() + "/runs/" + run.substr(0, run.size() - 8) + "/agent.h5", "--environment",
             "HalfCheetah", "--episodes", "1", "--observe", "served", "--json"});
    CAPTURE(served.err);
    CHECK(served.exit_code == (hidden ? 3 : 0));
    if (hidden) {
      CHECK(served.err.find("--observe served needs an agent") != std::string::npos);
    } else {
      CHECK(nlohmann::json::parse(served.out, nullptr, false)["returns"] == scoring["returns"]);
    }
  }
}

TEST_CASE(
    "A suite whose runner is killed at any moment goes on to the results of one that was not") {
  const std::string updates = "td3-bc = 400, bc = 300";
  const Suite undisturbed(updates), killed(updates);
  REQUIRE(Run(undisturbed.Command()).exit_code == 0);
  // Killed while it makes the data, when a run begins, and when the first one is done.
  for (const char* moment : {"make ", "start ", "start ", "done "}) {
    Tool runner(killed.Command());
    CHECK(runner.WaitForMessage(moment));
    runner.Kill();
  }
  const Outcome rest = Run(killed.Command());
  INFO(rest.out << rest.err);
  CHECK(rest.exit_code == 0);
  CHECK(killed.Results() == undisturbed.Results());
}

TEST_CASE("Two runners on one folder share the work") {
  const Suite suite("td3-bc = 300, bc = 300, iql = 100");
  Tool one(suite.Command({"--jobs", "1"})), other(suite.Command({"--jobs", "1"}));
  const Outcome first = one.Wait(), second = other.Wait();
  INFO(first.err << second.err);
  CHECK(first.exit_code == 0);
  CHECK(second.exit_code == 0);
  CHECK(Count(first.err + second.err, "make ") == 1);
  CHECK(Count(first.err + second.err, "start ") == 3);
  CHECK(suite.Results().size() == 3);
}

TEST_CASE("All processes of a suite use the daemon at an address") {
  const Suite suite("td3-bc = 20, bc = 20");
  REQUIRE(fs::create_directory(suite.File("data")));
  const PrivateDaemon daemon = StartDaemon({.data_folder = suite.File("data")});
  const std::string address = daemon.endpoint();
  Tool one(suite.Command({"--endpoint", address, "--jobs", "1"})),
      other(suite.Command({"--endpoint", address, "--jobs", "1"}));
  const Outcome first = one.Wait(), second = other.Wait();
  INFO(first.err << second.err);
  CHECK(first.exit_code == 0);
  CHECK(second.exit_code == 0);
  CHECK(Count(first.err + second.err, "start ") == 2);
  CHECK(fs::exists(suite.File("data/HalfCheetah/medium-v0.h5")));
  const Outcome both = Run(suite.Command({"--endpoint", address, "--data-folder", "x"}));
  CHECK(both.exit_code == 2);
  CHECK(both.err.find("exclude each other") != std::string::npos);
}

TEST_CASE("A runner that is told to stop leaves everything to be resumed, and the status says so") {
  const Suite suite("td3-bc = 1_000_000");
  const auto state = [&] {
    const Outcome status = Run(suite.Command({"--dry-run", "--json"}));
    return nlohmann::json::parse(status.out, nullptr, false)[0];
  };
  CHECK(state()["state"] == "waiting");
  Tool runner(suite.Command());
  CHECK(runner.WaitForMessage("start "));
  CHECK(state()["state"] == "running");
  runner.Signal(SIGTERM);
  const Outcome stopped = runner.Wait();
  CHECK(stopped.exit_code == 143);
  CHECK(stopped.out.find("1 left") != std::string::npos);
  const auto left = state();
  CHECK(left["state"] == "begun");
  CHECK(fs::exists(left["log"].get<std::string>()));
  CHECK(left["index"].is_null());
}

TEST_CASE("Only runs that are not done are submitted, each under its number in plan.json") {
  const Suite suite("td3-bc = 20, bc = 20, iql = 20");
  REQUIRE(Run(suite.Command({"--index", "1"})).exit_code == 0);
  Words words = suite.Command({"--dry-run", "--sbatch-option=--partition=long"});
  words[1] = "slurm";
  const Outcome script = Run(words);
  INFO(script.out << script.err);
  CHECK(script.exit_code == 0);
  CHECK(script.err.find("1 of 3 runs done, 0 in the queue, 2 to be submitted") !=
        std::string::npos);
  CHECK(script.out.find("\n#SBATCH --array=0,2\n") != std::string::npos);
  CHECK(script.out.find("\n#SBATCH --partition=long\n") != std::string::npos);
  CHECK(script.out == ReadBytes(suite.Out() + "/slurm.sh"));
  // A task by the script's own words.
  CHECK(ExitCodeOf("SLURM_ARRAY_TASK_ID=2 bash " + suite.Out() + "/slurm.sh") == 0);
  CHECK(suite.Results().size() == 2);
  words.insert(words.end(), {"--seeds", "7"});
  const Outcome foreign = Run(words);
  CHECK(foreign.exit_code == 3);
  CHECK(foreign.err.find("belongs to another command") != std::string::npos);
}

TEST_CASE("A run goes on until its score has settled, as often as is allowed") {
  // Two evaluations cannot tell whether the score has settled, so the run goes on at least once.
  const Suite suite("td3-bc = 60");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  const auto before = nlohmann::json::parse(suite.Results().begin()->second, nullptr, false);
  CHECK(before["settled"].is_null());
  const Outcome look = Run(suite.Command({"--until-settled", "2", "--dry-run", "--json"}));
  const auto due = nlohmann::json::parse(look.out, nullptr, false)[0];
  CHECK(due["state"] == "begun");
  CHECK(due["updates"] == 60);
  CHECK(due["target"] == 120);
  Words cluster = suite.Command({"--dry-run"});
  cluster[1] = "slurm";
  CHECK(Run(cluster).err.find("1 of 1 runs done") != std::string::npos);
  cluster.insert(cluster.end(), {"--until-settled", "2"});
  CHECK(Run(cluster).out.find(" --until-settled 2 ") != std::string::npos);
  const Outcome outcome = Run(suite.Command({"--until-settled", "2"}));
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 0);
  const auto after = nlohmann::json::parse(suite.Results().begin()->second, nullptr, false);
  CHECK(after["finished"] == true);
  CHECK(after["updates"].get<int>() >= 120);
  CHECK(after["updates"].get<int>() <= 180);
  CHECK((after["settled"] == true || after["updates"] == 180));
  CHECK(after["id"] == before["id"]);
  const Outcome again = Run(suite.Command({"--until-settled", "2"}));
  CHECK(again.exit_code == 0);
  CHECK(Count(again.err, "start ") == 0);
}

TEST_CASE("A larger budget that was cut off leaves the result of the smaller one, and can go on") {
  const Suite suite("td3-bc = 60");
  REQUIRE(Run(suite.Command()).exit_code == 0);
  const auto before = suite.Results();
  const auto state = [&] {
    const Outcome status = Run(suite.Command({"--dry-run", "--json"}));
    return nlohmann::json::parse(status.out, nullptr, false)[0];
  };
  const std::string smaller = ReadBytes(suite.File("budget.toml"));
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 20_000\nepisodes = 1\nrows = 2_000\n"
             "updates = { td3-bc = 1_000_000 }\n");
  REQUIRE(Run(suite.Command({"--hours", "0.002"})).exit_code == 0);
  CHECK(suite.Results() == before);
  const auto begun = state();
  CHECK(begun["state"] == "begun");
  CHECK(begun["updates"].get<uint64_t>() % 50 == 0);  // of the run, not of its result
  WriteBytes(suite.File("budget.toml"), smaller);
  const Outcome done = Run(suite.Command());
  CHECK(done.out.find("1 of 1 runs done") != std::string::npos);
  CHECK(done.err.find("start ") == std::string::npos);
  // Nothing is lost of what the larger one has begun.
  const fs::path run = fs::path(begun["log"].get<std::string>()).parent_path();
  CHECK(std::any_of(fs::directory_iterator(run), fs::directory_iterator(), [](const auto& entry) {
    return entry.path().filename().string().starts_with("checkpoint-");
  }));
}

TEST_CASE("A runner stops when its hours are over, and another one does what is left") {
  const Suite suite("td3-bc = 20");
  const Outcome stopped = Run(suite.Command({"--hours", "0.00001"}));
  INFO(stopped.out << stopped.err);
  CHECK(stopped.exit_code == 0);
  CHECK(stopped.out.find("0 of 1 runs done, 0 failed, 1 left") != std::string::npos);
  CHECK(suite.Results().empty());
  const Outcome done = Run(suite.Command());
  INFO(done.out << done.err);
  CHECK(done.out.find("1 of 1 runs done") != std::string::npos);
  CHECK(suite.Results().size() == 1);
}

TEST_CASE("The index of a frozen plan chooses one run of it") {
  const Suite suite("td3-bc = 20, bc = 20");
  const Outcome one = Run(suite.Command({"--index", "1"}));
  INFO(one.out << one.err);
  CHECK(one.exit_code == 0);
  const auto plan = nlohmann::json::parse(ReadBytes(suite.Out() + "/plan.json"), nullptr, false);
  REQUIRE(plan["runs"].size() == 2);
  REQUIRE(suite.Results().size() == 1);
  const std::string second = plan["runs"][1]["id"];
  CHECK(suite.Results().begin()->first.find(second) != std::string::npos);
  const Outcome out_of_time = Run(suite.Command({"--index", "0", "--hours", "0.00001"}));
  CHECK(out_of_time.exit_code == 1);
  CHECK(out_of_time.out.find("1 left") != std::string::npos);
  const Outcome beyond = Run(suite.Command({"--index", "2"}));
  CHECK(beyond.exit_code == 2);
  CHECK(beyond.err.find("0..1") != std::string::npos);
  const Outcome foreign = Run(suite.Command({"--index", "1", "--seeds", "5"}));
  CHECK(foreign.exit_code == 3);
  CHECK(foreign.err.find("belongs to another command") != std::string::npos);
  WriteBytes(suite.Out() + "/plan.json", R"({"runs": [5]})");
  const Outcome broken = Run(suite.Command({"--index", "0"}));
  CHECK(broken.exit_code == 3);
  CHECK(broken.err.find("is no list of runs") != std::string::npos);
}

TEST_CASE("What cannot be trained is named at the end and keeps nothing else back") {
  const Suite suite("bc = 20, sac = 20");
  // A file stands where the dataset's folder should be.
  fs::create_directories(suite.Out() + "/data");
  WriteBytes(suite.Out() + "/data/HalfCheetah", "");
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find("2 of 3 runs done, 1 failed") != std::string::npos);
  CHECK(outcome.out.find(
            "failed: HalfCheetah-bc-medium-s0: dataset HalfCheetah/medium-v0 could not") !=
        std::string::npos);
  CHECK(Count(outcome.err, "make HalfCheetah/medium") == 2);
}

TEST_CASE("A dataset that another process is making is waited for") {
  const Suite suite("bc = 20");
  fs::create_directories(suite.Out() + "/data/HalfCheetah");
  {
    const auto other = AtomicFile::Create(suite.Out() + "/data/HalfCheetah/medium-v0.h5");
    REQUIRE(other.ok());
    const Outcome waits = Run(suite.Command({"--hours", "0.0005"}));  // 1.8 s
    INFO(waits.out << waits.err);
    CHECK(waits.out.find("0 of 1 runs done, 0 failed, 1 left") != std::string::npos);
    CHECK(waits.err.find("make ") == std::string::npos);
  }
  const Outcome outcome = Run(suite.Command());
  INFO(outcome.out << outcome.err);
  CHECK(outcome.out.find("1 of 1 runs done, 0 failed") != std::string::npos);
}

TEST_CASE("A run that diverged is reported, and tried again only if that is asked for") {
  Suite suite;
  suite.pattern = "HalfCheetah/modelling-error/gravity+medium";
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 6\nepisodes = 1\nrows = 2_000\n"
             "updates = { bc = 20, sac = 300 }\n"
             // SAC's actor is no longer finite after 75 updates with so large a learning rate.
             "hyperparameters = { sac = { learning-rate = 1, warm-up = 500 } }\n");
  const Outcome first = Run(suite.Command());
  INFO(first.out << first.err);
  CHECK(first.exit_code == 1);
  CHECK(first.out.find("1 of 2 runs done, 1 failed") != std::string::npos);
  CHECK(first.out.find("failed: HalfCheetah-sac-gravity-s0: diverged: ") != std::string::npos);
  // Its result is that of its last evaluation, and says that no other one will come.
  for (const auto& [name, text] : suite.Results(false)) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    CAPTURE(name, text);
    CHECK(json["finished"] == (json["algorithm"] == "bc"));
    if (json["finished"]) continue;
    CHECK(json["updates"] == 50);
    CHECK(json["returns"].size() == 1);
    CHECK(json["diverged"].get<std::string>().find("diverged: ") != std::string::npos);
    CHECK(json["diverged"].get<std::string>().find(suite.Out()) == std::string::npos);
  }
  CHECK(suite.Results(false).size() == 2);
  const Outcome again = Run(suite.Command());
  CHECK(again.exit_code == 1);
  CHECK(again.out.find("diverged before; --retry") != std::string::npos);
  CHECK(Count(again.err, "start ") == 0);
  const Outcome retried = Run(suite.Command({"--retry"}));
  INFO(retried.out << retried.err);
  CHECK(retried.exit_code == 1);
  CHECK(Count(retried.err, "start HalfCheetah-sac") == 1);
}

TEST_CASE("A dataset that is not the published one of its name is refused") {
  const Suite suite("bc = 20");
  // A budget without `rows` asks for the whole dataset.
  WriteBytes(suite.File("budget.toml"),
             "[tiny]\nevaluations = 2\nepisodes = 1\nupdates = { bc = 20 }");
  const std::string data = suite.Out() + "/data";
  const Outcome made =
      Run({"dataset", "make", "HalfCheetah/medium", "--rows", "2000", "--quiet", "--data", data});
  REQUIRE(made.exit_code == 0);
  const char* const reason = "has 2000 rows, not the 1000000 of this run";
  const Outcome outcome = Run(suite.Command({"--data-folder", data}));
  INFO(outcome.out << outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.out.find(reason) != std::string::npos);
  const Outcome counted = Run(suite.Command({"--data-folder", data, "--dry-run"}));
  CHECK(counted.err.find(reason) != std::string::npos);
  CHECK(suite.Results().empty());
}

}  // namespace
}  // namespace b4mrl
