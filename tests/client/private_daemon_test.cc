#include "client/private_daemon.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "proto/base/clock.h"
#include "proto/base/unique_fd.h"
#include "tests/data/temporary_folder.h"
#include "tests/environment_variable.h"

namespace b4mrl {
namespace {

// A program that plays the server.
std::string WriteProgram(const TemporaryFolder& folder, const std::string& body,
                         const std::string& name = "program") {
  const std::string path = folder.File(name);
  std::ofstream(path) << "#!/bin/sh\n" << body << "\n";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

PrivateDaemonOptions Running(const TemporaryFolder& folder, const std::string& body) {
  PrivateDaemonOptions options;
  options.binary = WriteProgram(folder, body);
  return options;
}

constexpr char kWaits[] = "echo ready tcp://127.0.0.1:7; exec sleep 1000";

TEST_CASE("a daemon is ready when it says so, and ends with its object") {
  const TemporaryFolder folder;
  pid_t process = 0;
  {
    Result<PrivateDaemon> daemon = PrivateDaemon::Start(Running(folder, kWaits));
    INFO(daemon.status().ToString());
    REQUIRE(daemon.ok());
    CHECK(daemon->endpoint() == "tcp://127.0.0.1:7");
    process = daemon->process_id();
    CHECK(kill(process, 0) == 0);
  }
  CHECK(kill(process, 0) != 0);
}

TEST_CASE("stopping tells how the daemon ended") {
  const TemporaryFolder folder;
  Result<PrivateDaemon> daemon = PrivateDaemon::Start(Running(folder, kWaits));
  REQUIRE(daemon.ok());
  const int status = daemon->Stop();
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGTERM);
  CHECK(daemon->Stop() == 0);  // once is enough
}

TEST_CASE("a daemon that does not end is killed") {
  const TemporaryFolder folder;
  Result<PrivateDaemon> daemon = PrivateDaemon::Start(
      Running(folder, "trap '' TERM; echo ready x; while read -r line; do :; done < /dev/zero"));
  REQUIRE(daemon.ok());
  const int status = daemon->Stop(/*deadline_ms=*/100);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGKILL);
}

TEST_CASE("a daemon gets its address, folder, arguments and variables") {
  const TemporaryFolder folder;
  PrivateDaemonOptions options =
      Running(folder, "echo \"$@ $B4MRL_TEST\" > " + folder.File("arguments") + "; " + kWaits);
  options.data_folder = "/some/data";
  options.arguments = {"--workers", "2"};
  options.environment = {"B4MRL_TEST=variable"};
  std::string address;
  {
    const Result<PrivateDaemon> daemon = PrivateDaemon::Start(options);
    REQUIRE(daemon.ok());
    std::ifstream file(folder.File("arguments"));
    std::string bind, data, data_folder, own, workers, count, variable;
    file >> bind >> address >> data >> data_folder >> own >> workers >> count >> variable;
    CHECK(bind == "--bind");
    CHECK(address.starts_with("ipc:///"));
    CHECK(data + " " + data_folder == "--data /some/data");
    CHECK(own == "--own-folder");
    CHECK(workers + " " + count == "--workers 2");
    CHECK(variable == "variable");
  }
  // The sockets' folder goes with the daemon.
  const auto sockets = std::filesystem::path(address.substr(6)).parent_path();
  CHECK_FALSE(std::filesystem::exists(sockets));
}

TEST_CASE("a daemon gets no descriptor of its client's but stderr") {
  const TemporaryFolder folder;
  const UniqueFd ours(fcntl(STDOUT_FILENO, F_DUPFD, 100));  // above those that a shell opens itself
  const std::string open = folder.File("open");
  const std::string numbers = fmt::format("/proc/$$/fd/{}", ours.get());
  const Result<PrivateDaemon> daemon = PrivateDaemon::Start(
      Running(folder, fmt::format("readlink /proc/$$/fd/0 > {}; [ -e {} ] && echo {} >> {}; {}",
                                  open, numbers, ours.get(), open, kWaits)));
  REQUIRE(daemon.ok());
  CHECK(ReadBytes(open) == "/dev/null\n");
}

TEST_CASE("a client without a stdout has its daemon get ready") {
  const TemporaryFolder folder;
  const PrivateDaemonOptions options = Running(folder, kWaits);
  const pid_t client = fork();
  if (client == 0) {
    close(STDIN_FILENO);
    close(STDOUT_FILENO);
    const bool is_ready = PrivateDaemon::Start(options).ok();  // its daemon ends with the statement
    _exit(is_ready ? 0 : 1);
  }
  int status = 0;
  REQUIRE(waitpid(client, &status, 0) == client);
  CHECK(status == 0);
}

TEST_CASE("the launcher's name stands for the server beside it") {
  const TemporaryFolder folder;
  WriteProgram(folder, "exit 1", "b4mrl");
  WriteProgram(folder, kWaits, "b4mrl-serve");
  {
    const EnvironmentVariable variable("B4MRL_SERVER", folder.File("b4mrl"));
    CHECK(PrivateDaemon::Start().ok());
  }
  const TemporaryFolder other;
  std::filesystem::create_symlink(folder.File("b4mrl"), other.File("b4mrl"));
  const EnvironmentVariable variable("B4MRL_SERVER", other.File("b4mrl"));
  CHECK(PrivateDaemon::Start().ok());
}

TEST_CASE("a server that is missing, fails or stays silent is unavailable") {
  const TemporaryFolder folder;
  PrivateDaemonOptions missing;
  missing.binary = folder.File("nothing");
  CHECK(PrivateDaemon::Start(missing).status().code() == StatusCode::kUnavailable);
  CHECK(PrivateDaemon::Start(Running(folder, "exit 1")).status().code() ==
        StatusCode::kUnavailable);
  PrivateDaemonOptions silent = Running(folder, "exec sleep 1000");
  silent.ready_deadline_ms = 100;
  CHECK(PrivateDaemon::Start(silent).status().code() == StatusCode::kUnavailable);
}

TEST_CASE("a server that cannot use what it was given is no server that cannot be reached") {
  const TemporaryFolder folder;
  const Status refused = PrivateDaemon::Start(Running(folder, "exit 3")).status();
  CHECK(refused.code() == StatusCode::kIoError);
  CHECK(refused.message().find(folder.File("program")) != std::string::npos);
}

TEST_CASE("a daemon does not outlive a client that dies") {
  const TemporaryFolder folder;
  // Nobody is left to remove the daemon's own folder: the real one does it itself.
  const EnvironmentVariable temporary("TMPDIR", folder.path());
  const PrivateDaemonOptions options = Running(folder, kWaits);
  // The orphan becomes this process's child, so that its end can be waited for.
  REQUIRE(prctl(PR_SET_CHILD_SUBREAPER, 1) == 0);
  int report[2];
  REQUIRE(pipe2(report, O_CLOEXEC) == 0);
  const pid_t client = fork();
  if (client == 0) {
    Result<PrivateDaemon> daemon = PrivateDaemon::Start(options);
    const pid_t process = daemon.ok() ? daemon->process_id() : -1;
    (void)!write(report[1], &process, sizeof(process));
    _exit(0);  // no destructor runs
  }
  pid_t process = -1;
  REQUIRE(read(report[0], &process, sizeof(process)) == sizeof(process));
  close(report[0]);
  close(report[1]);
  CHECK(waitpid(client, nullptr, 0) == client);
  REQUIRE(process > 0);
  int status = 0;
  CHECK(waitpid(process, &status, 0) == process);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGTERM);
  prctl(PR_SET_CHILD_SUBREAPER, 0);
}

}  // namespace
}  // namespace b4mrl
