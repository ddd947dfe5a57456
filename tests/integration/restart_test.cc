// What clients notice when the daemon is started again at its address.
#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

// `b4mrl serve` with these options, until the object ends.
class Daemon {
 public:
  explicit Daemon(std::vector<std::string> options) {
    options.insert(options.begin(), "b4mrl-serve");
    REQUIRE(StartWithOutput(B4MRL_BINARY_DIR "/b4mrl-serve", std::move(options), &program_) == 0);
  }
  ~Daemon() {
    kill(program_.process_id, SIGTERM);
    WaitForExit(program_.process_id, Deadline::AfterMs(30'000));
  }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

 private:
  ProgramWithOutput program_;
};

TEST_CASE("After a restart sessions are lost at once, and clients and datasets go on") {
  const bool has_doors = GENERATE(true, false);
  CAPTURE(has_doors);
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.File("data/HalfCheetah"));
  RequireOk(WriteExample(folder.File("data/HalfCheetah/example.h5"),
                         MakeExampleDataset(std::vector<size_t>(4, 50), 17, 6)));
  const std::string address = "ipc://" + folder.File("socket");
  std::vector<std::string> options = {"--bind",    address, "--data", folder.File("data"),
                                      "--workers", "1"};
  if (!has_doors) options.emplace_back("--no-door");

  auto daemon = std::make_unique<Daemon>(options);
  Client client = Connect(address);
  RemoteEnvironment environment = Take(client.Make("HalfCheetah"));
  RemoteEnvironment unused = Take(client.Make("HalfCheetah"));
  REQUIRE((environment.transport() == "door") == has_doors);
  RequireOk(environment.Reset().status());
  const auto open = [&] {
    return Take(client.OpenDataset("HalfCheetah/example", {.corruption = {{"obs-noise", "0.1"}}}));
  };
  const auto observations_of = [](RemoteDataset& dataset) {
    const TransitionRows rows = Take(dataset.Sample(64, /*seed=*/5, /*batch=*/3));
    return std::vector<float>(rows.observations.begin(), rows.observations.end());
  };
  RemoteDataset dataset = open();
  const std::vector<float> before = observations_of(dataset);

  daemon.reset();
  daemon = std::make_unique<Daemon>(options);
  const std::vector<float> action(6, 0.5F);
  const Clock::time_point start = Clock::now();
  CHECK(environment.Step(std::span<const float>(action)).status().code() ==
        StatusCode::kSessionLost);
  CHECK(unused.Reset().status().code() == StatusCode::kSessionLost);
  CHECK(SecondsSince(start) < 10);  // far from the deadlines of these requests
  RemoteEnvironment another = Take(client.Make("HalfCheetah"));
  CHECK((another.transport() == "door") == has_doors);
  RequireOk(another.Reset().status());
  // The cache of its rows outlives the daemon, and its fingerprint names them as before.
  RemoteDataset again = open();
  CHECK(again.fingerprint() == dataset.fingerprint());
  CHECK(observations_of(dataset) == before);
}

}  // namespace
}  // namespace b4mrl
