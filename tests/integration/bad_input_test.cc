// What the daemon says, and ends with, when its command line or a request is wrong.
#include <fcntl.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "proto/base/child_program.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/loopback.h"

namespace b4mrl {
namespace {

constexpr char kServe[] = B4MRL_BINARY_DIR "/b4mrl-serve";
constexpr int kBadUsage = 2;
constexpr int kBadInput = 3;

struct Ended {
  int exit_code = -1;
  std::string output;  // both streams
};

// Runs `b4mrl-serve` with arguments that keep it from serving; one that serves all the same is
// killed.
Ended RunServe(std::vector<std::string> arguments) {
  const TemporaryFolder folder;
  const std::string log = folder.File("log");
  arguments.insert(arguments.begin(), kServe);
  const std::vector<char*> pointers = PointersTo(arguments);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_CREAT | O_WRONLY, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t child = -1;
  const int error = posix_spawn(&child, kServe, &actions, nullptr, pointers.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  REQUIRE(error == 0);
  const int status = WaitForExit(child, Deadline::AfterMs(30'000));
  INFO(ReadBytes(log));
  REQUIRE(WIFEXITED(status));
  return {WEXITSTATUS(status), ReadBytes(log)};
}

void RequireEnd(const std::vector<std::string>& arguments, int exit_code,
                const std::vector<std::string>& words) {
  const Ended ended = RunServe(arguments);
  INFO(ended.output);
  REQUIRE(ended.exit_code == exit_code);
  for (const std::string& word : words) {
    CAPTURE(word);
    REQUIRE(ended.output.find(word) != std::string::npos);
  }
  REQUIRE(ended.output.find("ready tcp:") == std::string::npos);
  REQUIRE(ended.output.find("ready ipc:") == std::string::npos);
}

class Daemon {
 public:
  explicit Daemon(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.begin(), {"--workers", "1", "--threads", "1"});
    daemon_ = std::make_unique<PrivateDaemon>(
        StartDaemon({.data_folder = data_.path(), .arguments = std::move(arguments)}));
  }
  const std::string& endpoint() const { return daemon_->endpoint(); }
  Client Connect() const { return b4mrl::Connect(endpoint()); }

 private:
  TemporaryFolder data_;
  std::unique_ptr<PrivateDaemon> daemon_;
};

void RequireError(const Status& status, StatusCode code, const std::string& words) {
  INFO(status.ToString());
  REQUIRE(status.code() == code);
  REQUIRE(status.message().find(words) != std::string::npos);
}

TEST_CASE("A port in use ends the start with its address and the reason") {
  const TemporaryFolder data;
  const UniqueFd taken = ListenOnLoopback(0);
  REQUIRE(taken.valid());
  const std::string address = "tcp://127.0.0.1:" + std::to_string(PortOf(taken));
  RequireEnd({"--data", data.path(), "--bind", address}, kBadInput,
             {address, "Address already in use"});
}

TEST_CASE("An ipc socket in use is refused, and its daemon goes on") {
  const Daemon daemon;
  const TemporaryFolder data;
  RequireEnd({"--data", data.path(), "--bind", daemon.endpoint()}, kBadInput,
             {daemon.endpoint(), "Address already in use"});
  Client client = daemon.Connect();
  REQUIRE(client.ServerStatus().ok());
}

TEST_CASE("Folders that are not there are named") {
  const TemporaryFolder data;
  const std::string missing = data.File("nowhere");
  RequireEnd({"--data", missing, "--bind", "tcp://127.0.0.1:0"}, kBadInput,
             {"--data", missing, "No such file or directory"});
  RequireEnd({"--data", data.path(), "--models", missing, "--bind", "tcp://127.0.0.1:0"}, kBadInput,
             {"--models", missing, "No such file or directory"});
  WriteBytes(missing, "a file");
  RequireEnd({"--data", missing, "--bind", "tcp://127.0.0.1:0"}, kBadInput, {"Not a directory"});
}

TEST_CASE("Flags outside their range and unknown ones are bad usage") {
  RequireEnd({"--workers", "0"}, kBadUsage, {"--workers", "1..64"});
  RequireEnd({"--threads", "many"}, kBadUsage, {"--threads"});
  RequireEnd({"--wrokers", "2"}, kBadUsage, {"--wrokers"});
  const Ended help = RunServe({"--help"});
  REQUIRE(help.exit_code == 0);
  REQUIRE(help.output.find("--bind") != std::string::npos);
}

TEST_CASE("Addresses that cannot be, and those that others could reach, are refused") {
  const TemporaryFolder data;
  const auto refused = [&data](const std::string& address, const std::string& word) {
    RequireEnd({"--data", data.path(), "--bind", address}, kBadUsage, {address, word});
  };
  refused("7700", "tcp://HOST:PORT");
  refused("tcp://127.0.0.1", "tcp://HOST:PORT");
  refused("udp://127.0.0.1:1", "or ipc://PATH");
  refused("tcp://127.0.0.1:70000", "--bind is 'tcp://127.0.0.1:70000', allowed: tcp://HOST:PORT");
  refused("tcp://0.0.0.0:0", "--insecure");
  refused("tcp://*:0", "--insecure");
}

TEST_CASE("A configuration file is checked key by key") {
  const TemporaryFolder data;
  const std::string file = data.File("serve.toml");
  const auto refused = [&](const std::string& text, const std::vector<std::string>& words) {
    WriteBytes(file, text);
    RequireEnd({"--data", data.path(), "--config", file}, kBadInput, words);
  };
  refused("worker = 2\n", {file, "did you mean 'workers'?"});
  refused("workers = 1000\n", {file, "workers", "1..64"});
  refused("workers = 'two'\n", {file, "workers is 'two'", "1..64"});
  refused("pin = 'yes'\n", {file, "pin is 'yes'", "true or false"});
  refused("data = 7\n", {file, "data is '7'", "a string"});
  refused("spin = -1\n", {file, "spin is '-1'", "0.."});
  refused("bind = ['tcp://127.0.0.1:0', 5]\n", {file, "bind is '5'", "a list of addresses"});
  refused("bind = []\n", {file, "bind is '[]'", "a list of addresses"});
  refused("threads = = 2\n", {file, "line 1"});
  RequireEnd({"--data", data.path(), "--config", data.File("none.toml")}, kBadInput, {"none.toml"});
  const std::string pipe = data.File("pipe.toml");
  REQUIRE(mkfifo(pipe.c_str(), 0600) == 0);
  RequireEnd({"--data", data.path(), "--config", pipe}, kBadInput,
             {"--config is '" + pipe + "', allowed: a regular file"});
}

TEST_CASE("Unknown names are answered with the nearest known one") {
  const Daemon daemon;
  Client client = daemon.Connect();
  RequireError(client.Make("HalfCheeta").status(), StatusCode::kUnknownName,
               "did you mean 'HalfCheetah'?");
  RequireError(client.Make("HalfCheetah", {.simulator = {{"gravty", "2"}}}).status(),
               StatusCode::kUnknownName, "did you mean 'gravity'?");
  RequireError(client.Make("HalfCheetah", {.simulator = {{"hidden", "v-rot-z"}}}).status(),
               StatusCode::kUnknownName, "did you mean");
  RequireError(client.FindEnvironment("halfcheetah").status(), StatusCode::kUnknownName,
               "did you mean 'HalfCheetah'?");
  RequireError(client.OpenDataset("HalfCheetah/medium").status(), StatusCode::kUnknownName,
               "HalfCheetah/medium");
}

TEST_CASE("Sessions out of range are refused with the range") {
  const Daemon daemon;
  Client client = daemon.Connect();
  RequireError(client.Make("HalfCheetah", {.num_envs = 1025}).status(),
               StatusCode::kInvalidArgument, "0..1024");
  RequireError(client.Make("HalfCheetah", {.simulator = {{"gravity", "heavy"}}}).status(),
               StatusCode::kInvalidArgument, "heavy");
  RequireError(client.Make("HalfCheetah", {.simulator = {{"hidden", "17"}}}).status(),
               StatusCode::kInvalidArgument, "17");
  RequireError(client.Make("HalfCheetah", {.config = "{\"max_episode_steps\": "}).status(),
               StatusCode::kInvalidArgument, "not valid JSON at byte 23");
  RequireError(client.Make("HalfCheetah", {.config = R"({"reset_noise_scale": NaN})"}).status(),
               StatusCode::kInvalidArgument, "N')");
  RequireError(client.Make("HalfCheetah", {.config = R"({"max_episode_step": 5})"}).status(),
               StatusCode::kUnknownName, "max_episode_steps");
}

TEST_CASE("A refused step is not executed, and the session goes on") {
  const Daemon daemon;
  Client client = daemon.Connect();
  Result<RemoteEnvironment> environment = client.Make("HalfCheetah", {.num_envs = 2, .seed = 3});
  Result<RemoteEnvironment> undisturbed = client.Make("HalfCheetah", {.num_envs = 2, .seed = 3});
  REQUIRE(environment.ok());
  REQUIRE(undisturbed.ok());
  std::vector<float> actions(12, 0.5f);
  RequireError(environment->Step(std::span<const float>(actions)).status(),
               StatusCode::kFailedPrecondition, "reset");
  REQUIRE(environment->Reset().ok());
  REQUIRE(undisturbed->Reset().ok());
  actions[7] = std::numeric_limits<float>::quiet_NaN();
  RequireError(environment->Step(std::span<const float>(actions)).status(),
               StatusCode::kInvalidArgument, "lane 1: actions[1] is 'nan'");
  actions[7] = 0.5f;
  const Result<StepOutcome> outcome = environment->Step(std::span<const float>(actions));
  const Result<StepOutcome> expected = undisturbed->Step(std::span<const float>(actions));
  REQUIRE(outcome.ok());
  REQUIRE(expected.ok());
  REQUIRE(outcome->digests[0] == expected->digests[0]);
  REQUIRE(outcome->digests[1] == expected->digests[1]);
}

}  // namespace
}  // namespace b4mrl
