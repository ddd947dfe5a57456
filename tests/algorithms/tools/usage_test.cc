// What the command line accepts, how it explains itself, and what it says when it does not.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/list.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/client/fake_daemon.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// Every option that takes a count or a seed, behind what its command needs beside it.
struct CountOption {
  Words command;
  const char* option;
};
std::vector<CountOption> CountOptions() {
  const Words train = {"train", "--algorithm", "sac", "--environment", "HalfCheetah"};
  const Words evaluate = {"evaluate", "--agent", "none.h5", "--environment", "HalfCheetah"};
  const Words dataset = {"dataset", "info", "HalfCheetah/none"};
  std::vector<CountOption> options;
  for (const char* name : {"--seed", "--updates", "--history", "--eval-every", "--eval-episodes",
                           "--log-every", "--checkpoint-every", "--threads", "--corruption-seed"}) {
    options.push_back({train, name});
  }
  for (const char* name : {"--episodes", "--seed"}) options.push_back({evaluate, name});
  for (const char* name : {"--rows", "--seed"}) {
    options.push_back({{"dataset", "make", "HalfCheetah/none"}, name});
  }
  options.push_back({{"dataset", "export", "HalfCheetah/none", "none.h5"}, "--corruption-seed"});
  options.push_back({{"dataset", "info", "HalfCheetah/none"}, "--corruption-seed"});
  for (const char* name : {"--decisions", "--seed"}) {
    options.push_back({{"demo", "confounding"}, name});
  }
  for (const char* name : {"--workers", "--threads", "--lease", "--cache", "--memory", "--spin"}) {
    options.push_back({{"serve"}, name});
  }
  options.push_back({{"perf", "batch"}, "--turns"});
  for (const char* name : {"--jobs", "--until-settled", "--index"}) {
    options.push_back({{"benchmark", "run"}, name});
  }
  for (const char* name : {"--jobs", "--episodes", "--seed"}) {
    options.push_back({{"benchmark", "evaluate", "none"}, name});
  }
  options.push_back({{"benchmark", "check", "none"}, "--jobs"});
  options.push_back({{"benchmark", "slurm"}, "--array-parallelism"});
  return options;
}

}  // namespace

TEST_CASE("A count or seed below zero ends with code 2, its name, its value and a short range") {
  for (const auto& [command, option] : CountOptions()) {
    Words words = command;
    words.insert(words.end(), {option, "-5"});
    const Outcome outcome = Run(words);
    INFO(command[0] << " " << option << ": " << outcome.err);
    CHECK(outcome.exit_code == 2);
    CHECK(Says(outcome.err, std::string(option) + ": -5 is not a whole number in "));
    CHECK(outcome.err.size() < 200);
  }
}

TEST_CASE("Counts and seeds may be written with an exponent") {
  const Outcome plain = Run({"demo", "confounding", "--decisions", "2000", "--seed", "10"});
  REQUIRE(plain.exit_code == 0);
  CHECK(Run({"demo", "confounding", "--decisions", "2e3", "--seed=1e1"}).out == plain.out);
  CHECK(Run({"demo", "confounding", "--decisions", "2e-1"}).exit_code == 2);
}

TEST_CASE("A number that is none ends with code 2") {
  const Outcome hours = Run({"benchmark", "run", "nothing", "--hours", "nan"});
  CHECK(hours.exit_code == 2);
  CHECK(Says(hours.err, "--hours: nan is not a number in 0"));
  const Outcome seconds = Run({"perf", "nothing", "--seconds", "nan"});
  CHECK(seconds.exit_code == 2);
  CHECK(Says(seconds.err, "--seconds: nan is not a number in 0"));
}

TEST_CASE("A folder that holds no results is bad input") {
  const TemporaryFolder folder;
  for (const Words& words : {Words{"report"}, Words{"benchmark", "check"},
                             Words{"benchmark", "leaderboard"}, Words{"benchmark", "evaluate"}}) {
    Words command = words;
    command.push_back(folder.path());
    const Outcome outcome = Run(command);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 3);
    CHECK(Says(outcome.err, folder.path() + " holds no "));
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("A report of whose results none fits its suites is bad input, and says why") {
  const TemporaryFolder folder;
  for (int i = 0; i < 30; ++i) WriteBytes(folder.File(std::to_string(i) + ".json"), "no JSON");
  WriteBytes(folder.File("0.json"),
             R"({"id": "1", "cell": "c", "algorithm": "mine", "source": "user", "updates": 7, )"
             R"("benchmarks": ["HalfCheetah/mine/a"], "curve": [[7, 0, 1.0, 0.0, null]]})");
  const Outcome outcome = Run({"report", folder.path()});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 3);
  CHECK(outcome.out.empty());
  CHECK(Says(outcome.err, "1.json was left out: "));
  CHECK(Says(outcome.err, "and 10 more"));
  CHECK(Says(outcome.err, "every result was left out"));
  CHECK(Count(outcome.err, "\n") == 22);
  for (int i = 1; i < 30; ++i) {
    REQUIRE(std::filesystem::remove(folder.File(std::to_string(i) + ".json")));
  }
  CHECK(Says(Run({"report", folder.path()}).err,
             "0.json was left out: it names no benchmark of these suites (--suites for your own)"));
}

TEST_CASE("Every program ends with code 3 where its output finds no room") {
  const std::string results = B4MRL_SOURCE_DIR "/benchmarks/results";
  for (const std::string& words :
       {std::string("demo confounding --decisions 1000"), std::string("list algorithms --json"),
        "report '" + results + "'", "benchmark leaderboard '" + results + "'",
        std::string("perf --help")}) {
    INFO(words);
    const std::string command = "'" B4MRL_BINARY_DIR "/b4mrl' " + words + " 2>&1 >/dev/full";
    FILE* pipe = popen(command.c_str(), "r");
    REQUIRE(pipe != nullptr);
    std::string err;
    for (int c = 0; (c = std::fgetc(pipe)) != EOF;) err += static_cast<char>(c);
    CHECK(WEXITSTATUS(pclose(pipe)) == 3);
    CHECK(Says(err, ": cannot write stdout: No space left on device\n"));
  }
}

TEST_CASE("Every program of the command line tells its version and its help") {
  const Outcome version = Run({"--version"});
  REQUIRE(version.exit_code == 0);
  // The commits may differ, because not every build makes every program.
  const std::regex line(
      R"(b4mrl \d+\.\d+\.\d+, commit (unknown|[0-9a-f]{12}(-dirty)?), learners for .+\n)");
  CHECK(std::regex_match(version.out, line));
  for (const char* command : {"serve", "perf", "benchmark", "report"}) {
    const Outcome outcome = Run({command, "--version"});
    INFO(outcome.out);
    CHECK(outcome.exit_code == 0);
    CHECK(std::regex_match(outcome.out, line));
  }
  const Outcome help = Run({"--help"});
  const size_t subcommands = help.out.find("Subcommands:");
  REQUIRE(subcommands != std::string::npos);
  for (const char* name : {"\n  train ", "\n  serve ", "\n  perf ", "\n  help "}) {
    CHECK(help.out.find(name) > subcommands);
    CHECK(Says(help.out, name));
  }
  CHECK(Run({"help"}).out == help.out);
  for (const Words& words :
       std::vector<Words>{{"train"}, {"dataset", "make"}, {"serve"}, {"perf"}}) {
    Words asked = {"help"}, flagged = words;
    asked.insert(asked.end(), words.begin(), words.end());
    flagged.emplace_back("--help");
    INFO(words[0]);
    CHECK(Run(asked).exit_code == 0);
    CHECK(Run(asked).out == Run(flagged).out);
  }
}

TEST_CASE("perf python says why it measures nothing") {
  const TemporaryFolder folder;
  const std::string python = folder.File("python3");
  std::ofstream(python) << "#!/bin/sh\nprintf 'failed this Python has no package b4mrl\\n' >&0\n";
  std::filesystem::permissions(python, std::filesystem::perms::owner_all);
  const std::string before = std::getenv("PATH");
  setenv("PATH", (folder.path() + ":" + before).c_str(), 1);
  const Outcome outcome = Run({"perf", "python"});
  setenv("PATH", before.c_str(), 1);
  CHECK(outcome.exit_code == 4);
  CHECK(Says(outcome.err, "this Python has no package b4mrl"));
}

TEST_CASE("A data folder that is none is bad input") {
  const TemporaryFolder folder;
  const Outcome missing = Run({"list", "datasets", "--data", folder.File("none")});
  CHECK(missing.exit_code == 3);
  CHECK(Says(missing.err, "cannot use --data " + folder.File("none") + ": No such file"));
  WriteBytes(folder.File("file"), "");
  const Outcome file = Run({"list", "datasets", "--data", folder.File("file")});
  CHECK(file.exit_code == 3);
  CHECK(Says(file.err, folder.File("file") + ": Not a directory"));
}

TEST_CASE("A temporary folder too deep for sockets is not used for them") {
  const TemporaryFolder folder;
  const std::string deep = folder.File(std::string(140, 'd'));
  std::filesystem::create_directory(deep);
  const Outcome outcome = Run({"list", "environments"}, {"TMPDIR=" + deep});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 0);
}

TEST_CASE("A temporary folder that is none is bad input, and the message names it") {
  const TemporaryFolder folder;
  const std::string missing = folder.File("none");
  for (const Words& words : {Words{"perf", "batch"}, Words{"list", "environments"}}) {
    const Outcome outcome = Run(words, {"TMPDIR=" + missing});
    INFO(words[0] << outcome.err);
    CHECK(outcome.exit_code == 3);
    CHECK(Says(outcome.err, "cannot make the folder " + missing + "/b4mrl"));
  }
}

TEST_CASE("A learner with an ensemble has two threads unless it is told otherwise") {
  TemporaryFolder folder;
  const std::string data = folder.File("data");
  REQUIRE(
      Run({"dataset", "make", "HalfCheetah/medium", "--rows", "1000", "--data", data}).exit_code ==
      0);
  WriteBytes(folder.File("small.toml"),
             "algorithm = \"mopo\"\nenvironment = \"HalfCheetah\"\n"
             "dataset = \"HalfCheetah/medium\"\neval-episodes = 1\nhidden-width = 8\n"
             "ensemble-width = 8\nensemble-max-updates = 2\nensemble-cache = false\n"
             "rollout-rows = 10\ndata = \"" +
                 data + "\"\n");
  const auto threads = [&](const std::string& run, const Words& more) {
    Words train = {"train", "--config", folder.File("small.toml"), "--out", folder.File(run)};
    train.insert(train.end(), more.begin(), more.end());
    const Outcome outcome = Run(train);
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    const std::string record = ReadBytes(folder.File(run + "/run.json"));
    return nlohmann::json::parse(record, nullptr, false)["threads"].get<int>();
  };
  CHECK(threads("default", {"--updates", "2"}) == 2);
  CHECK(threads("one", {"--updates", "2", "--threads", "1"}) == 1);
  CHECK(threads("one", {"--updates", "4", "--resume"}) == 1);
  // What changes no bit may change in the midst of a run.
  CHECK(threads("one", {"--updates", "6", "--resume", "--ensemble-cache", "true"}) == 1);
}

TEST_CASE("Training without an algorithm names those that there are") {
  const Outcome outcome = Run({"train", "--environment", "HalfCheetah"});
  CHECK(outcome.exit_code == 2);
  CHECK(Says(outcome.err, "--algorithm"));
  CHECK_FALSE(Says(outcome.err, "unknown"));
  for (const Algorithm& algorithm : Algorithms()) {
    CHECK(Says(outcome.err, std::string(algorithm.name)));
  }
}

TEST_CASE("Corruptions are the perturbations that datasets take") {
  const auto names = [](const char* kind) {
    const Outcome outcome = Run({"list", kind, "--json"});
    REQUIRE(outcome.exit_code == 0);
    std::vector<std::string> found;
    for (const auto& item : nlohmann::json::parse(outcome.out, nullptr, false)) {
      if (item["corrupts_datasets"] == true) found.push_back(item["name"]);
    }
    return found;
  };
  CHECK(names("corruptions") == names("perturbations"));
  CHECK_FALSE(names("corruptions").empty());
  CHECK_FALSE(Says(Run({"list", "corruptions"}).out, "gravity"));
}

TEST_CASE("The list of perturbations tells how each is written and what it takes") {
  const std::string text = Run({"list", "perturbations"}).out;
  CHECK(Says(text, "gravity=<factor> in "));
  CHECK(Says(text, "hidden=<dimensions>"));
  CHECK(Says(text, "model=<file>: "));
}

TEST_CASE("The list of datasets has those that are there and those that can be made") {
  const TemporaryFolder folder;
  const Words words = {"list", "datasets", "--data", folder.path()};
  const Outcome empty = Run(words);
  CHECK(empty.exit_code == 0);
  CHECK(Says(empty.out, "not made; 1000000 rows, mean return 4739.2"));
  CHECK(Says(empty.out, "cannot be made: no agent"));
  CHECK(empty.err.empty());
  REQUIRE(Run({"dataset", "make", "HalfCheetah/medium", "--rows", "1e3", "--data", folder.path()})
              .exit_code == 0);
  const Outcome made = Run(words);
  CHECK(Says(made.out, "HalfCheetah/medium-v0 "));
  CHECK_FALSE(Says(made.out, "not made; 1000000 rows, mean return 4739.2"));
  CHECK_FALSE(Says(made.out, "not imported"));
  CHECK(made.err.empty());
  REQUIRE(Run({"dataset", "info", "HalfCheetah/medium", "--data", folder.path()}).exit_code == 0);
  CHECK(Says(Run(words).out, "1000 rows, not the rows published under this name"));
}

TEST_CASE("A dataset that was made as published is listed with its published figures") {
  const TemporaryFolder folder;
  const nlohmann::json published = nlohmann::json::parse(
      Run({"list", "datasets", "--json", "--data", folder.path()}).out, nullptr, false);
  const auto medium = std::ranges::find(published, "HalfCheetah/medium-v0",
                                        [](const auto& item) { return item["name"]; });
  REQUIRE(medium != published.end());
  const FakeDaemon daemon([&](FakeServer& server, FakeCall& call) {
    if (!call.request.has_list_datasets()) return false;
    pb::Reply reply;
    reply.mutable_list_datasets()->set_total(1);
    pb::DatasetInfo* info = reply.mutable_list_datasets()->add_datasets();
    info->set_name("HalfCheetah/medium-v0");
    info->set_rows(1'000'000);
    info->set_columns_sha256((*medium)["columns_sha256"]);
    server.Reply(call, std::move(reply));
    return true;
  });
  const nlohmann::json listed = nlohmann::json::parse(
      Run({"list", "datasets", "--json", "--endpoint", daemon.address()}).out, nullptr, false);
  REQUIRE(listed.is_array());
  CHECK(listed[0]["as_published"] == true);
  CHECK(listed[0]["mean_return"] == (*medium)["mean_return"]);
  CHECK(listed[0]["normalised_score"] == (*medium)["normalised_score"]);
}

TEST_CASE("Dimensions that are joined by a comma are told to be joined by a plus") {
  const auto evaluate = [](const std::string& simulator) {
    return Run({"evaluate", "--agent", B4MRL_SOURCE_DIR "/data/agents/halfcheetah-medium.h5",
                "--environment", "HalfCheetah", "--episodes", "1", "--simulator", simulator});
  };
  for (const char* simulator : {"hidden=1,2", "hidden=1,v-root-z"}) {
    const Outcome outcome = evaluate(simulator);
    CHECK(outcome.exit_code == 5);
    CHECK(Says(outcome.err, "joined by +"));
  }
  CHECK(evaluate("hidden = 1+2").exit_code == 0);
}

}  // namespace b4mrl
