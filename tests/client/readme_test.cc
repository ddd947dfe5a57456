// The C++ programs of README.md: they stand there as they are here or among the examples, and run.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdio>
#include <fstream>
#include <string>
#include <utility>

#include "client/client.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

// A file of the checkout without its lines' indentation.
std::string LinesOf(const std::string& path) {
  std::ifstream file(std::string(B4MRL_SOURCE_DIR "/") + path);
  std::string text;
  for (std::string line; std::getline(file, line);) {
    text += line.substr(std::min(line.find_first_not_of(' '), line.size())) + "\n";
  }
  REQUIRE(!text.empty());
  return text;
}

// The block of C++ in README.md that has `words`.
std::string BlockWith(const std::string& words) {
  const std::string readme = LinesOf("README.md");
  const size_t found = readme.find(words);
  REQUIRE(found != std::string::npos);
  const size_t begin = readme.rfind("```cpp\n", found) + 7;
  return readme.substr(begin, readme.find("```", begin) - begin);
}

TEST_CASE("The first program of the README is an example that runs") {
  const std::string program = BlockWith("Client::Connect");
  CHECK_THAT(LinesOf("client/examples/first_steps.cc"), Catch::Contains(program));
  TestDaemon daemon;
  const std::string command = "'" B4MRL_BINARY_DIR "/first_steps' " + daemon.endpoint();
  FILE* output = popen(command.c_str(), "r");
  REQUIRE(output != nullptr);
  std::array<char, 200> line{};
  const bool printed = fgets(line.data(), line.size(), output) != nullptr;
  CHECK(pclose(output) == 0);
  REQUIRE(printed);
  CHECK_THAT(line.data(), Catch::StartsWith("return of the first lane: "));
}

TEST_CASE("The README's lines about a benchmark open its sources and score a policy") {
  CHECK_THAT(LinesOf("tests/client/readme_test.cc"),
             Catch::Contains(BlockWith("client->FindBenchmark")));
  TestDaemon daemon;
  daemon.MakeDataset("medium", 300);
  Result<Client> client = Client::Connect(daemon.endpoint());
  RequireOk(client.status());

  auto bench = client->FindBenchmark("HalfCheetah/confounding/hidden-high+medium");
  auto simulator = bench->MakeSimulator({.num_envs = 8});
  auto data = bench->OpenDataset();
  const auto policy = [](const b4mrl::PolicyBatch& batch) {
    std::ranges::fill(batch.actions, 0.0f);  // a row for each of batch.observations
    return b4mrl::Status();
  };
  auto scores = bench->Evaluate(policy, {.episodes = 10, .held_out = true});

  REQUIRE(scores.ok());
  CHECK(scores->returns.size() == 10);
  CHECK(Take(std::move(simulator)).num_envs() == 8);
  CHECK(Take(std::move(data)).rows() == 300);
}

}  // namespace
}  // namespace b4mrl
