#include "client/benchmark_run.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <map>
#include <string>

#include "tests/results.h"

namespace b4mrl {
namespace {

// The variables that the runner sets; unset when the object ends.
class Variables {
 public:
  Variables() {
    for (const auto& [name, value] : values_) setenv(name.c_str(), value.c_str(), 1);
  }
  Variables(const Variables&) = delete;
  Variables& operator=(const Variables&) = delete;
  ~Variables() {
    for (const auto& [name, value] : values_) unsetenv(name.c_str());
  }

 private:
  const std::map<std::string, std::string> values_ = {
      {"B4MRL_ENDPOINT", "ipc:///tmp/daemon"},
      {"B4MRL_BENCHMARK", "HalfCheetah/clean/medium"},
      {"B4MRL_SEED", "2"},
      {"B4MRL_UPDATES", "70"},
      {"B4MRL_LEDGER", "9"},
      {"B4MRL_OUT", "/tmp/out"}};
};

TEST_CASE("A learner of the user's own finds the run that the runner asks for") {
  const Variables variables;
  const BenchmarkRun run = Take(ReadBenchmarkRun());
  CHECK(run.endpoint == "ipc:///tmp/daemon");
  CHECK(run.benchmark == "HalfCheetah/clean/medium");
  CHECK(run.seed == 2);
  CHECK(run.updates == 70);
  CHECK(run.ledger == 9);
  CHECK(run.out == "/tmp/out");
}

TEST_CASE("A variable that the runner would have set, or a number that is none, is named") {
  const Variables variables;
  setenv("B4MRL_UPDATES", "many", 1);
  const Status unread = ReadBenchmarkRun().status();
  CHECK(unread.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(unread.message(), Catch::Contains("B4MRL_UPDATES is 'many'"));
  unsetenv("B4MRL_BENCHMARK");
  const Status missing = ReadBenchmarkRun().status();
  CHECK(missing.code() == StatusCode::kFailedPrecondition);
  CHECK_THAT(missing.message(), Catch::Contains("B4MRL_BENCHMARK is not set"));
}

}  // namespace
}  // namespace b4mrl
