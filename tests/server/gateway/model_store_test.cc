// What is remembered of the models that were compiled.
#include "server/gateway/model_store.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <string>

#include "proto/base/limits.h"
#include "tests/server/models/compiler_script.h"

namespace b4mrl {
namespace {

TEST_CASE("Taken or refused, a file is compiled again only when it has changed") {
  const CompilerScript script;
  ModelStore store(script.options());
  const std::atomic<bool> never{false};
  const auto ask = [&](const std::string& file) {
    script.Drop(file);
    return store.Compile("Hopper", file, never).status().code();
  };
  for (int i = 0; i < 3; ++i) {
    CHECK(ask("refused.xml") == StatusCode::kInvalidArgument);
    CHECK(ask("good.xml") == StatusCode::kOk);
    script.Drop("other.xml", std::to_string(i));  // a neighbour changes nothing
  }
  CHECK(script.runs("refused.xml") == 1);
  CHECK(script.runs("good.xml") == 1);
}

TEST_CASE("No two compilations try their model out in one file") {
  const CompilerScript script;
  ModelStore store(script.options());
  const std::atomic<bool> never{false};
  for (const char* file : {"one.xml", "two.xml"}) {
    script.Drop(file);
    REQUIRE(store.Compile("Hopper", file, never).ok());
  }
  const std::string trials = script.trials();
  REQUIRE(trials.size() % 2 == 0);
  const std::string first = trials.substr(0, trials.size() / 2);
  CHECK_THAT(first, Catch::StartsWith(".trial-") && Catch::EndsWith(".mjb\n"));
  CHECK(first != trials.substr(trials.size() / 2));
}

TEST_CASE("Trials that a killed gateway has left are removed, and take no model's place") {
  namespace fs = std::filesystem;
  const CompilerScript script;
  const std::string cache = ModelCacheFolder(script.options().data_folder);
  fs::create_directories(cache);
  const auto write = [&](const std::string& name, std::chrono::milliseconds age) {
    WriteBytes(cache + "/" + name, "model");
    fs::last_write_time(cache + "/" + name, fs::file_time_type::clock::now() - age);
  };
  const std::chrono::milliseconds longest(limits::kModelCompilerMs);
  write(".trial-0000000000000001.mjb", 2 * longest);
  write(".trial-0000000000000002.mjb", longest / 2);  // another daemon may be writing it
  for (uint32_t i = 0; i + 1 < limits::kMaxCompiledModels; ++i) {
    write(std::to_string(i) + ".mjb", 2 * longest);
  }
  ModelStore store(script.options());
  const std::atomic<bool> never{false};
  script.Drop("good.xml");
  REQUIRE(store.Compile("Hopper", "good.xml", never).ok());
  CHECK_FALSE(fs::exists(cache + "/.trial-0000000000000001.mjb"));
  CHECK(fs::exists(cache + "/.trial-0000000000000002.mjb"));
  const auto count =
      std::distance(fs::directory_iterator(cache), fs::directory_iterator());  // with the trial
  CHECK(count == limits::kMaxCompiledModels + 1);
}

TEST_CASE("What a file refers to may have changed, so it counts with its folder") {
  const CompilerScript script;
  ModelStore store(script.options());
  const std::atomic<bool> never{false};
  script.Drop("refused.xml", "<mujoco><include file='part.xml'/></mujoco>");
  script.Drop("part.xml", "a");
  for (int i = 0; i < 2; ++i) CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 1);
  script.Drop("part.xml", "bb");
  CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 2);
  script.Drop("refused.xml", "<mujoco/>");
  CHECK_FALSE(store.Compile("Hopper", "refused.xml", never).ok());
  CHECK_FALSE(store.Compile("Walker2d", "refused.xml", never).ok());
  CHECK(script.runs("refused.xml") == 4);
}

}  // namespace
}  // namespace b4mrl
