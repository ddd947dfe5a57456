// What the words of `b4mrl benchmark` may be, and which of them are refused.
#include <catch2/catch.hpp>
#include <string>

#include "tests/benchmarks/runner/suite.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

TEST_CASE("Words that are wrong are refused as wrong usage, unknown ones with the nearest name") {
  const auto says = [](const Words& more, const std::string& words) {
    Words all = more;
    all.insert(all.begin(), {"benchmark", "run", "--dry-run"});
    const Outcome outcome = Run(all);
    CAPTURE(outcome.err);
    return outcome.exit_code == 2 && outcome.err.find(words) != std::string::npos;
  };
  CHECK(says({"HalfCheetah/modeling-error/gravity+medium"}, "modelling-error"));
  CHECK(says({"Hopper/claen/*"},
             "unknown benchmark 'Hopper/claen/*'; did you mean 'Hopper/clean/*'? "
             "(`b4mrl list benchmarks` has all)"));
  CHECK(says({"*/cleann/medium"}, "did you mean '*/clean/medium'?"));
  CHECK(says({"--budget", "smal"}, "did you mean 'small'"));
  CHECK(says({"--algorithms", "td3bc"}, "td3-bc"));
  CHECK(says({"--seeds", "x"}, "--seeds is 'x'"));
  CHECK(says({"--learner", "true", "--name", "a b"}, "--name is 'a b'"));
  const auto says_beside_learner = [&](const Words& more, const std::string& words) {
    Words all = {"--learner", "true", "--name", "mine"};
    all.insert(all.end(), more.begin(), more.end());
    return says(all, words);
  };
  CHECK(says_beside_learner({"--data", "d4rl"}, "exclude each other"));
  CHECK(says_beside_learner({"--algorithms", "bc"}, "--algorithms is 'bc'"));
  CHECK(says_beside_learner({"--until-settled", "1"}, "--until-settled is 1"));
}

TEST_CASE("The jobs of one submission share the number of tasks at a time") {
  const Suite suite("bc = 20, td3-bc = 20");
  const auto shares = [&](const std::string& tasks) {
    Words words = suite.Command({"--seeds", "0..599", "--dry-run", "--array-parallelism", tasks});
    words[1] = "slurm";
    words[2] = "HalfCheetah/clean/medium";
    const Outcome outcome = Run(words);
    INFO(outcome.err);
    CHECK(outcome.exit_code == 0);
    CHECK((outcome.err.find("2 tasks at a time instead of 1") != std::string::npos) ==
          (tasks == "1"));
    std::string found;
    for (const char* script : {"/slurm.sh", "/slurm+1001.sh"}) {
      const std::string text = ReadBytes(suite.Out() + script);
      const size_t sign = text.find('%', text.find("--array="));
      found += text.substr(sign, text.find('\n', sign) - sign);
    }
    return found;
  };
  CHECK(shares("5") == "%3%2");
  CHECK(shares("1") == "%1%1");
}

TEST_CASE("A perturbation that a suite misspells is found before anything is trained") {
  const TemporaryFolder suites;
  WriteBytes(suites.File("bad.toml"),
             "version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\nname = \"bad\"\n"
             "simulators = [\"legg=0.9\"]\n");
  const PrivateDaemon elsewhere = StartDaemon({.data_folder = suites.path()});
  for (const Words& more : {Words(), Words{"--endpoint", elsewhere.endpoint()}}) {
    Words words = {"benchmark", "run", "--dry-run", "Hopper/bad/*", "--suites", suites.path()};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = Run(words);
    INFO(outcome.out << outcome.err);
    CHECK(outcome.exit_code == 3);  // its daemon says it, and ends
    CHECK(outcome.err.find("benchmark Hopper/bad/legg=0.9, simulators: ") != std::string::npos);
    CHECK(outcome.err.find("did you mean 'leg'?") != std::string::npos);
  }
}

TEST_CASE("A suite that is wrong ends every command that reads it as wrong input") {
  const TemporaryFolder suites;
  const std::string head =
      "version = \"v0\"\nenvironment = \"Hopper\"\n[[challenge]]\nname = \"bad\"\n";
  for (const std::string& text : {std::string("version = "), head + "simulator = [\"gravity\"]\n",
                                  head + "simulators = [\"legg=0.9\"]\n"}) {
    WriteBytes(suites.File("bad.toml"), text);
    for (const Words& command : {Words{"benchmark", "run", "--dry-run", "Hopper/bad/*"},
                                 Words{"list", "benchmarks"}, Words{"serve"}}) {
      Words words = command;
      words.insert(words.end(), {"--suites", suites.path()});
      CAPTURE(text, words[0]);
      CHECK(Run(words).exit_code == 3);
    }
  }
}

TEST_CASE("Seeds up to the largest one are a range") {
  const Suite suite("bc = 20");
  const Outcome last =
      Run(suite.Command({"--dry-run", "--seeds", "18446744073709551613..18446744073709551614"}));
  INFO(last.err);
  CHECK(last.out.find("2 runs: 0 done") != std::string::npos);
  const Outcome beyond =
      Run(suite.Command({"--dry-run", "--seeds", "18446744073709550616..18446744073709551615"}));
  CHECK(beyond.exit_code == 2);
  CHECK(beyond.err.find("18446744073709550616..18446744073709551614") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
