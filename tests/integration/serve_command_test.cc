// `b4mrl serve` as a command: what it prints, refuses and ends with.
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "tests/integration/daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;
const std::string kServe = B4MRL_BINARY_DIR "/b4mrl-serve";

struct Outcome {
  int exit_code = -1;
  std::string errors;
};

// Runs the server to its end; it is killed after 30 s.
Outcome Run(std::vector<std::string> arguments) {
  int ends[2];
  REQUIRE(pipe2(ends, O_CLOEXEC) == 0);
  arguments.insert(arguments.begin(), kServe);
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    alarm(30);
    dup2(ends[1], STDERR_FILENO);
    dup2(open("/dev/null", O_WRONLY), STDOUT_FILENO);
    execv(kServe.c_str(), pointers.data());
    _exit(127);
  }
  close(ends[1]);
  Outcome outcome;
  char buffer[4096];
  for (ssize_t size; (size = read(ends[0], buffer, sizeof(buffer))) > 0;) {
    outcome.errors.append(buffer, static_cast<size_t>(size));
  }
  close(ends[0]);
  int wait_status = 0;
  waitpid(child, &wait_status, 0);
  if (WIFEXITED(wait_status)) outcome.exit_code = WEXITSTATUS(wait_status);
  return outcome;
}

bool Mentions(const Outcome& outcome, const std::string& text) {
  INFO(outcome.errors);
  return outcome.errors.find(text) != std::string::npos;
}

PrivateDaemon Start(std::vector<std::string> arguments) {
  return StartDaemon({.tcp = true, .arguments = std::move(arguments)});
}

TEST_CASE("Bad flags end with code 2 and a message that names them") {
  const std::string data = fs::temp_directory_path();
  REQUIRE(Run({"--bogus"}).exit_code == 2);
  REQUIRE(Run({"--workers", "0"}).exit_code == 2);
  REQUIRE(Run({"--threads", "many"}).exit_code == 2);
  const Outcome scheme = Run({"--data", data, "--bind", "udp://127.0.0.1:1"});
  REQUIRE(scheme.exit_code == 2);
  REQUIRE(Mentions(scheme, "udp://127.0.0.1:1"));
  const Outcome open = Run({"--data", data, "--bind", "tcp://0.0.0.0:0"});
  REQUIRE(open.exit_code == 2);
  REQUIRE(Mentions(open, "--insecure"));
}

TEST_CASE("A missing folder or file ends with code 3 and its name") {
  const Outcome data = Run({"--data", "/nonexistent/data"});
  REQUIRE(data.exit_code == 3);
  REQUIRE(Mentions(data, "/nonexistent/data"));
  const std::string folder = fs::temp_directory_path();
  const Outcome models = Run({"--data", folder, "--models", "/nonexistent/models"});
  REQUIRE(models.exit_code == 3);
  REQUIRE(Mentions(models, "/nonexistent/models"));
  const Outcome config = Run({"--data", folder, "--config", "/nonexistent/file.toml"});
  REQUIRE(config.exit_code == 3);
  REQUIRE(Mentions(config, "/nonexistent/file.toml"));
}

TEST_CASE("A misspelt key of the configuration file is named with the nearest known one") {
  const fs::path file = fs::temp_directory_path() / ("b4mrl-" + std::to_string(getpid()) + ".toml");
  std::ofstream(file) << "worker = 2\n";
  const Outcome outcome = Run({"--data", fs::temp_directory_path(), "--config", file});
  fs::remove(file);
  REQUIRE(outcome.exit_code == 3);
  REQUIRE(Mentions(outcome, "did you mean 'workers'"));
}

TEST_CASE("A port in use ends with code 3 and the address, and the running daemon goes on") {
  PrivateDaemon daemon = Start({"--workers", "1"});
  const Outcome outcome =
      Run({"--data", fs::temp_directory_path(), "--workers", "1", "--bind", daemon.endpoint()});
  REQUIRE(outcome.exit_code == 3);
  REQUIRE(Mentions(outcome, daemon.endpoint()));
  REQUIRE(Mentions(outcome, "in use"));
  REQUIRE(Client::Connect(daemon.endpoint()).ok());
}

TEST_CASE("An ipc socket in use is refused, and one left by a killed daemon is taken over") {
  const std::string path =
      fs::temp_directory_path() / ("b4mrl-" + std::to_string(getpid()) + ".sock");
  const std::string address = "ipc://" + path;
  {
    PrivateDaemon daemon = Start({"--workers", "1", "--bind", address});
    REQUIRE(Client::Connect(address).ok());
    const Outcome outcome = Run({"--data", fs::temp_directory_path(), "--bind", address});
    REQUIRE(outcome.exit_code == 3);
    REQUIRE(Mentions(outcome, address));
    REQUIRE(kill(daemon.process_id(), SIGKILL) == 0);
  }
  REQUIRE(fs::exists(path));
  {
    PrivateDaemon daemon = Start({"--workers", "1", "--bind", address});
    REQUIRE(Client::Connect(address).ok());
    const int wait_status = daemon.Stop();
    REQUIRE(WIFEXITED(wait_status));
    REQUIRE(WEXITSTATUS(wait_status) == 0);
  }
  REQUIRE_FALSE(fs::exists(path));
  REQUIRE_FALSE(fs::exists(path + ".worker-0"));
  REQUIRE_FALSE(fs::exists(path + ".dataset"));
}

// What a session of `lanes` lanes returns over `steps` steps under constant actions: all digests.
std::vector<uint64_t> Digests(const std::vector<std::string>& arguments, uint32_t sessions) {
  constexpr uint32_t kLanes = 8;
  PrivateDaemon daemon = Start(arguments);
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  std::vector<RemoteEnvironment> environments;
  for (uint32_t i = 0; i < sessions; ++i) {
    EnvironmentOptions options;
    options.num_envs = kLanes / sessions;
    options.seed = 3 + i * (kLanes / sessions);
    options.simulator = {{"obs-noise", "0.05"}, {"friction", "0.3"}};
    Result<RemoteEnvironment> environment = client->Make("HalfCheetah", options);
    REQUIRE(environment.ok());
    environments.push_back(std::move(*environment));
  }
  std::vector<uint64_t> digests;
  for (RemoteEnvironment& environment : environments) {
    REQUIRE(environment.Reset().ok());
    const std::vector<float> actions(environment.num_envs() * 6, 0.25f);
    for (int step = 0; step < 50; ++step) {
      const Result<StepOutcome> outcome = environment.Step(std::span<const float>(actions));
      REQUIRE(outcome.ok());
      if (step < 49) continue;
      digests.insert(digests.end(), outcome->digests.begin(), outcome->digests.end());
    }
  }
  return digests;
}

TEST_CASE("Numbers depend on no count of workers, threads or clients") {
  const std::vector<uint64_t> expected = Digests({"--workers", "1", "--threads", "1"}, 1);
  REQUIRE(expected.size() == 8);
  REQUIRE(Digests({"--workers", "2", "--threads", "1"}, 1) == expected);
  REQUIRE(Digests({"--workers", "1", "--threads", "4"}, 1) == expected);
  REQUIRE(Digests({"--workers", "2", "--threads", "4"}, 8) == expected);
  REQUIRE(Digests({"--workers", "2", "--threads", "2", "--pin"}, 1) == expected);
}

}  // namespace
}  // namespace b4mrl
