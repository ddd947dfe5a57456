// What the command line says of misspelt words and of options that have no effect.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

TEST_CASE("A misspelt word is named with what it might mean") {
  const std::vector<std::pair<Words, std::string>> cases = {
      {{"trein"}, "unknown command 'trein'; did you mean 'train'"},
      {{"dataset", "mke"}, "unknown command 'mke'; did you mean 'make'"},
      {{"benchmark", "rn"}, "unknown command 'rn'; did you mean 'run'"},
      {{"evaluate", "--agnt", "x"}, "unknown option '--agnt'; did you mean '--agent'"},
      {{"dataset", "import", "x.h5", "HalfCheetah/mine"},
       "argument is 'HalfCheetah/mine', allowed: options and values as in --help; file requires "
       "--name"},
      // The file of options, which need not exist, is of two commands alone.
      {{"list", "algorithms", "--config", "x.toml"}, "unknown option '--config'"},
      {{"dataset", "make", "HalfCheetah/random", "--config=x.toml"}, "unknown option '--config'"},
      {{"--endpoint", "ipc:///x", "list", "environments"},
       "option is '--endpoint', allowed: behind its command, list"},
      {{"--endpoint=ipc:///x", "train", "--algorithm", "sac"},
       "option is '--endpoint', allowed: behind its command, train"},
      {{"benchmark", "run", "--budjet=x"}, "unknown option '--budjet'; did you mean '--budget'"},
      // A hyperparameter, which is no option of the command, is not taken for the mistake.
      {{"train", "--gamma", "0.9", "--updates", "x"}, "--updates: x is not a whole number"},
      {{"serve", "--wrokers", "3"}, "unknown option '--wrokers'; did you mean '--workers'"},
      {{"report", "--ou", "x"}, "unknown option '--ou'; did you mean '--out'"},
      {{"perf", "--tuns", "3"}, "unknown option '--tuns'; did you mean '--turns'"}};
  for (const auto& [words, message] : cases) {
    const Outcome outcome = Run(words);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 2);
    CHECK(Says(outcome.err, message));
    CHECK_FALSE(Says(outcome.err, "--role"));  // hidden options are not for users
  }
}

TEST_CASE("Options without an effect are refused, and so is an address that is none") {
  const std::vector<std::pair<Words, std::string>> cases = {
      {{"benchmark", "run", "nothing", "--json"}, "--dry-run"},
      {{"dataset", "export", "a/b", "c", "--format", "minari", "--replace"}, "--replace"},
      {{"status", "--endpoint", ""}, "--endpoint"},
      {{"list", "environments", "--endpoint", ""}, "--endpoint"},
      {{"benchmark", "run", "nothing", "--endpoint", ""}, "--endpoint"},
      {{"perf", "nothing", "--endpoint", ""}, "--endpoint"}};
  for (const auto& [words, name] : cases) {
    const Outcome outcome = Run(words);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 2);
    CHECK(Says(outcome.err, name));
  }
  CHECK(Run({"list", "algorithms"}, {"B4MRL_ENDPOINT="}).exit_code == 0);
}

TEST_CASE(
    "An address that is none is a wrong option wherever it stands, and help comes before it") {
  const std::vector<Words> commands = {{"status"},
                                       {"list", "environments"},
                                       {"dataset", "info", "HalfCheetah/medium"},
                                       {"benchmark", "run", "nothing"},
                                       {"perf", "nothing"}};
  for (const Words& command : commands) {
    Words with_flag = command;
    with_flag.insert(with_flag.end(), {"--endpoint", "127.0.0.1:7811"});
    for (const Outcome& outcome :
         {Run(with_flag), Run(command, {"B4MRL_ENDPOINT=127.0.0.1:7811"})}) {
      CAPTURE(command.front(), outcome.err);
      CHECK(outcome.exit_code == 2);
      CHECK(Says(outcome.err, "'127.0.0.1:7811', allowed: tcp://HOST:PORT"));
    }
  }
  for (const Words& command :
       {Words{"--help"}, {"--version"}, {"train", "--help"}, {"status", "--help"}}) {
    CHECK(Run(command, {"B4MRL_ENDPOINT=127.0.0.1:7811"}).exit_code == 0);
  }
}

TEST_CASE("The last of an option's values counts") {
  const Outcome outcome = Run({"report", "none", "--at", "no budget", "--at", "5"});
  CHECK(outcome.exit_code == 3);
  CHECK(Says(outcome.err, "cannot list none"));
  // Each value of a list counts.
  const Outcome binds = Run({"serve", "--bind", "first", "--bind", "second"});
  CHECK(Says(binds.err, "--bind is 'first'"));
}

TEST_CASE("A dataset that can be made is told by the command that makes it") {
  const TemporaryFolder folder;
  const Words data = {"--data", folder.path()};
  const std::vector<Words> commands = {
      {"train", "--algorithm", "bc", "--environment", "HalfCheetah", "--dataset",
       "HalfCheetah/medium"},
      {"dataset", "info", "HalfCheetah/medium"},
      {"dataset", "export", "HalfCheetah/medium", folder.File("file.h5")}};
  for (Words words : commands) {
    words.insert(words.end(), data.begin(), data.end());
    const Outcome outcome = Run(words);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 5);
    CHECK(Says(outcome.err, "`b4mrl dataset make HalfCheetah/medium` makes it"));
  }
  for (const char* name : {"HalfCheetah/mine", "Humanoid/medium"}) {  // no recipe; no agent for it
    CHECK_FALSE(Says(Run({"dataset", "info", name, "--data", folder.path()}).err, "makes it"));
  }
}

TEST_CASE("A run whose simulator, world or corruption is misspelt has no folder") {
  const TemporaryFolder folder;
  const std::string data = folder.File("data"), out = folder.File("run");
  REQUIRE(
      Run({"dataset", "make", "HalfCheetah/medium", "--rows", "1e3", "--data", data}).exit_code ==
      0);
  const auto train = [&](const Words& more) {
    Words words = {"train", "--environment", "HalfCheetah", "--out", out, "--data", data};
    words.insert(words.end(), more.begin(), more.end());
    return Run(words);
  };
  for (const Words& words : {Words{"--algorithm", "sac", "--simulator", "grvity"},
                             Words{"--algorithm", "sac", "--world", "action-dely"},
                             Words{"--algorithm", "bc", "--dataset", "HalfCheetah/medium",
                                   "--corruption", "hidden=99"}}) {
    const Outcome outcome = train(words);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 5);
    CHECK_FALSE(std::filesystem::exists(out));
  }
}

}  // namespace
}  // namespace b4mrl
