// `b4mrl dataset` on a data folder of a test's own. For tests.
#pragma once

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

struct DatasetCommands {
  TemporaryFolder folder;

  Outcome Dataset(Words words) const {
    words.insert(words.begin(), "dataset");
    words.insert(words.end(), {"--data", folder.File("data")});
    return Run(words);
  }
  nlohmann::json Info(const std::string& name, const Words& more = {}) const {
    Words words = {"info", name, "--json"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = Dataset(words);
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    return nlohmann::json::parse(outcome.out, nullptr, false);
  }
};

}  // namespace b4mrl
