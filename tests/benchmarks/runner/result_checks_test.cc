// What is said of an agent that lies beside its result and cannot be scored.
#include "benchmarks/runner/result_checks.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "data/files/file_hash.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr char kAgent[] = B4MRL_SOURCE_DIR "/data/agents/hopper-medium.h5";

// The faults of a result of Hopper whose agent lies beside it.
std::vector<std::string> FaultsWith(const ResultCheckOptions& chosen) {
  const TemporaryFolder folder;
  std::filesystem::copy_file(kAgent, folder.File("agent.h5"));
  const nlohmann::ordered_json result = {{"source", "own"},
                                         {"environment", "Hopper"},
                                         {"returns", std::vector<double>(10, 1.0)},
                                         {"agent_sha256", Take(Sha256OfFile(kAgent))}};
  WriteBytes(folder.File("result.json"), result.dump());
  ResultCheckOptions options = chosen;
  options.path = folder.path();
  CheckSources sources;
  sources.find_environment = [](const std::string& name) -> Result<EnvironmentSpec> {
    return Status(StatusCode::kUnknownName, name);
  };
  const auto checked = Take(CheckResults(options, sources));
  REQUIRE(checked.size() == 1);
  CHECK(checked[0].agent == AgentCheck::kScored);
  return checked[0].faults;
}

TEST_CASE("An agent that plays for longer than its deadline is stopped, and named") {
  const auto faults = FaultsWith({.endpoint = "ipc:///nowhere/socket", .scoring_deadline_ms = 0});
  REQUIRE_FALSE(faults.empty());
  CHECK(faults.back() == "its agent could not be scored within 0 s");
}

TEST_CASE("The code of an evaluation that fails is told") {
  const auto faults = FaultsWith({.endpoint = "ipc:///nowhere/socket"});
  REQUIRE_FALSE(faults.empty());
  CHECK(faults.back() == "its agent could not be scored: code 4");
}

}  // namespace
}  // namespace b4mrl
