// Plays the conformance table against a server and prints one line a case:
//   conformance ENDPOINT [CASES.json [doors]]
// With `doors`, messages to workers go through their local doors.
// Exit code 0: all passed; 1: some did not; 2: bad usage; 3: the table cannot be read; 4: nobody
// answers.
#include <fmt/format.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/conformance/case_runner.h"

namespace b4mrl::conformance {
namespace {

int RunAll(const std::string& endpoint, const nlohmann::json& cases, bool use_doors) {
  CaseRunner runner(endpoint, use_doors);
  if (const Status status = runner.Connect(); !status.ok()) {
    fmt::print(stderr, "{}: {}\n", endpoint, status.ToString());
    return 4;
  }
  int failed = 0;
  for (const nlohmann::json& json : cases) {
    const Status status = runner.Run(json);
    fmt::print("{} {}\n", status.ok() ? "ok    " : "FAILED", json.at("name").get<std::string>());
    if (!status.ok()) fmt::print("       {}\n", status.message());
    failed += status.ok() ? 0 : 1;
  }
  fmt::print("{} of {} cases passed\n", cases.size() - failed, cases.size());
  return failed == 0 ? 0 : 1;
}

int Main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    fmt::print(stderr, "usage: conformance ENDPOINT [CASES.json [doors]]\n");
    return 2;
  }
  const std::string path = argc > 2 ? argv[2] : B4MRL_SOURCE_DIR "/tests/conformance/cases.json";
  try {
    std::ifstream file(path);
    return RunAll(argv[1], nlohmann::json::parse(file), argc > 3);
  } catch (const std::exception& error) {  // of the table; a server's bytes raise none
    fmt::print(stderr, "{}: {}\n", path, error.what());
    return 3;
  }
}

}  // namespace
}  // namespace b4mrl::conformance

int main(int argc, char** argv) { return b4mrl::conformance::Main(argc, argv); }
