// `b4mrl serve` as a command: what its flags and signals do. bad_input_test has what it refuses.
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "tests/data/example_dataset.h"
#include "tests/integration/support/daemon.h"
#include "tests/loopback.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

PrivateDaemon Start(std::vector<std::string> arguments) {
  return StartDaemon({.tcp = true, .arguments = std::move(arguments)});
}

int64_t LeaseOf(std::vector<std::string> arguments) {
  const PrivateDaemon daemon = StartDaemon({.arguments = std::move(arguments)});
  return static_cast<int64_t>(Connect(daemon.endpoint()).hello().limits().session_lease_ms());
}

TEST_CASE("Clients are told the lease: the flag's, the file's, or that of the addresses") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("serve.toml"), "lease = 9\n");
  REQUIRE(LeaseOf({"--lease", "7"}) == 7'000);
  REQUIRE(LeaseOf({"--config", folder.File("serve.toml")}) == 9'000);
  REQUIRE(LeaseOf({"--config", folder.File("serve.toml"), "--lease", "7"}) == 7'000);
  REQUIRE(LeaseOf({}) == 3'600'000);
  REQUIRE(LeaseOf({"--bind", "tcp://0.0.0.0:0", "--insecure"}) == 300'000);
}

TEST_CASE("Datasets whose caches do not fit what the flag allows are refused, others are served") {
  const TemporaryFolder data;
  fs::create_directories(data.File("HalfCheetah"));
  // 8,000 rows of 166 bytes: more than one MiB and less than two.
  RequireOk(WriteExample(data.File("HalfCheetah/new.h5"),
                         MakeExampleDataset(std::vector<size_t>(16, 500), 17, 6)));
  const auto open = [&](const char* mib) {
    const PrivateDaemon daemon =
        StartDaemon({.data_folder = data.path(), .arguments = {"--workers", "1", "--cache", mib}});
    return Connect(daemon.endpoint()).OpenDataset("HalfCheetah/new", {}).status();
  };
  const Status refused = open("1");
  CHECK(refused.code() == StatusCode::kLimitExceeded);
  CHECK(refused.message().find("allowed: 1048576") != std::string::npos);
  RequireOk(open("2"));
}

std::string TransportWith(std::vector<std::string> arguments, bool tcp) {
  const PrivateDaemon daemon = StartDaemon({.tcp = tcp, .arguments = std::move(arguments)});
  Client client = Connect(daemon.endpoint());
  client.set_reporter([](const std::string&) {});  // of the relay
  const Result<RemoteEnvironment> environment = client.Make("HalfCheetah", {});
  REQUIRE(environment.ok());
  return std::string(environment->transport());
}

TEST_CASE("Clients of this machine use the local door, unless a flag or the file says no") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("no.toml"), "no-door = true\nspin = 0\n");
  CHECK(TransportWith({}, false) == "door");
  CHECK(TransportWith({"--spin", "0"}, true) == "door");
  CHECK(TransportWith({"--no-door"}, false) == "ipc");
  CHECK(TransportWith({"--no-door"}, true) == "tcp");
  CHECK(TransportWith({"--config", folder.File("no.toml")}, true) == "tcp");
  CHECK(TransportWith({"--single-port"}, true) == "relay");
}

// How the daemon ends by itself, as waitid gives it; its exit is still to be collected.
siginfo_t AwaitEnd(const PrivateDaemon& daemon) {
  const Deadline deadline = Deadline::AfterMs(30'000);
  siginfo_t info{};
  const auto id = static_cast<id_t>(daemon.process_id());
  while (waitid(P_PID, id, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == 0 &&
         !deadline.expired()) {
    poll(nullptr, 0, 1);
  }
  return info;
}

TEST_CASE("SIGTERM, SIGINT, SIGQUIT and SIGHUP end the daemon with code 0, SIGUSR1 and 2 do not") {
  const int signal = GENERATE(SIGTERM, SIGINT, SIGQUIT, SIGHUP);
  CAPTURE(signal);
  const PrivateDaemon daemon = Start({"--workers", "1"});
  for (const int meaningless : {SIGUSR1, SIGUSR2}) {
    REQUIRE(kill(daemon.process_id(), meaningless) == 0);
    CHECK(Connect(daemon.endpoint()).Make("HalfCheetah").ok());
  }
  REQUIRE(kill(daemon.process_id(), signal) == 0);
  const siginfo_t end = AwaitEnd(daemon);
  REQUIRE(end.si_code == CLD_EXITED);
  REQUIRE(end.si_status == 0);
}

TEST_CASE("systemd is told when the daemon is ready and when it stops") {
  const TemporaryFolder folder;
  const std::string path = folder.File("notify");
  const UniqueFd manager(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  REQUIRE(path.size() < sizeof(address.sun_path));
  path.copy(address.sun_path, path.size());
  REQUIRE(bind(manager.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
  const auto received = [&] {
    char text[100];
    const ssize_t size = recv(manager.get(), text, sizeof(text), MSG_DONTWAIT);
    return size < 0 ? "" : std::string(text, static_cast<size_t>(size));
  };
  const PrivateDaemon daemon =
      StartDaemon({.arguments = {"--workers", "1"}, .environment = {"NOTIFY_SOCKET=" + path}});
  RequireOk(WaitUntilReady(manager.get(), POLLIN, Deadline::AfterMs(30'000)));
  CHECK(received() == "READY=1");
  CHECK(received() == "");
  REQUIRE(kill(daemon.process_id(), SIGTERM) == 0);
  AwaitEnd(daemon);
  CHECK(received() == "STOPPING=1");
}

TEST_CASE("Every process of the daemon has a name of its own") {
  const PrivateDaemon daemon = Start({"--workers", "2"});
  const pb::ServerStatusReply status = *Connect(daemon.endpoint()).ServerStatus();
  std::set<std::string> names;
  for (const pb::WorkerStatus& process : status.workers()) {
    names.insert(ReadBytes("/proc/" + std::to_string(process.process_id()) + "/comm"));
  }
  // The system keeps 15 characters.
  CHECK(names == std::set<std::string>{"b4mrl-gateway\n", "b4mrl-dataset-w\n", "b4mrl-worker-0\n",
                                       "b4mrl-worker-1\n"});
}

// Changes how this process, and what it starts meanwhile, answers a signal.
class Disposition {
 public:
  Disposition(int number, sighandler_t wanted) : number_(number), before_(signal(number, wanted)) {}
  ~Disposition() { signal(number_, before_); }

 private:
  int number_;
  sighandler_t before_;
};

TEST_CASE("A daemon under nohup outlives its terminal, and a script's its Ctrl-C") {
  const int ignored = GENERATE(SIGHUP, SIGINT);
  CAPTURE(ignored);
  std::optional<PrivateDaemon> daemon;
  {
    const Disposition ignore(ignored, SIG_IGN);
    daemon = Start({"--workers", "1"});
  }
  // A signal that is blocked would be queued for the daemon to read, though it is ignored.
  const std::string status = ReadBytes("/proc/" + std::to_string(daemon->process_id()) + "/status");
  const auto mask = [&](const std::string& name) {
    const size_t at = status.find(name + ":");
    REQUIRE(at != status.npos);
    return std::stoull(status.substr(at + name.size() + 1), nullptr, 16);
  };
  CHECK((mask("SigIgn") >> (ignored - 1) & 1) == 1);
  CHECK((mask("SigBlk") >> (ignored - 1) & 1) == 0);
  CHECK((mask("SigBlk") >> (SIGTERM - 1) & 1) == 1);
  REQUIRE(kill(daemon->process_id(), ignored) == 0);
  CHECK(Connect(daemon->endpoint()).Make("HalfCheetah").ok());
}

TEST_CASE("A daemon whose parent ignored SIGCHLD replaces its processes all the same") {
  std::optional<PrivateDaemon> daemon;
  {
    const Disposition ignore(SIGCHLD, SIG_IGN);
    daemon = Start({"--workers", "1"});
  }
  Client client = Connect(daemon->endpoint());
  RemoteEnvironment environment = Take(client.Make("HalfCheetah"));
  REQUIRE(environment.Reset().ok());
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& child : status.workers()) {
    if (child.role() == "worker-0") kill(static_cast<pid_t>(child.process_id()), SIGKILL);
  }
  CHECK(environment.Reset().ok());
  const int wait_status = daemon->Stop();
  CHECK(WIFEXITED(wait_status));
  CHECK(WEXITSTATUS(wait_status) == 0);
}

TEST_CASE("Clients in any folder are told where a relative ipc path leads") {
  const TemporaryFolder folder;
  const std::string path = fs::relative(folder.File("socket"));
  REQUIRE_FALSE(path.starts_with("/"));
  const PrivateDaemon daemon = Start({"--bind", "ipc://" + path});
  Client client = Connect("ipc://" + folder.File("socket"));
  const fs::path told = client.hello().dataset_port().ipc();
  REQUIRE(told.is_absolute());
  REQUIRE(fs::exists(told));
}

TEST_CASE("What the daemon makes is its user's alone, whatever the umask says") {
  const TemporaryFolder folder;
  const std::string data = folder.File("data");
  fs::create_directory(data);
  WriteBytes(folder.File("mine.xml"), ReadBytes(B4MRL_SOURCE_DIR "/data/models/hopper.xml"));
  const mode_t before = umask(0);
  std::optional<PrivateDaemon> daemon(
      StartDaemon({.data_folder = data,
                   .arguments = {"--workers", "1", "--models", folder.path(), "--bind",
                                 "ipc://" + folder.File("socket")}}));
  umask(before);
  Client client = Connect("ipc://" + folder.File("socket"));
  EnvironmentOptions options;
  options.simulator = Take(ParseNamedArguments("model=mine.xml"));  // leaves a compiled copy
  REQUIRE(client.Make("Hopper", options).ok());
  std::vector<fs::path> made = {folder.File("socket"), client.hello().dataset_port().ipc()};
  for (const auto& entry : fs::recursive_directory_iterator(data)) made.push_back(entry.path());
  REQUIRE(made.size() >= 5);  // with .b4mrl-cache, its models, one of them
  for (const fs::path& path : made) {
    INFO(path);
    CHECK((fs::status(path).permissions() & ~fs::perms::owner_all) == fs::perms::none);
  }
}

// The first of `count` free ports in a row, which are let go again; 0 if some of them were taken.
uint16_t FreePorts(int count) {
  std::vector<UniqueFd> held;
  held.push_back(ListenOnLoopback(0));
  const int first = PortOf(held[0]);
  for (int port = first + 1; port < first + count; ++port) {
    if (port < 65536) held.push_back(ListenOnLoopback(static_cast<uint16_t>(port)));
    if (port >= 65536 || !held.back().valid()) return 0;
  }
  return static_cast<uint16_t>(first);
}

TEST_CASE("Workers listen on the ports after the gateway's, the dataset worker on the next") {
  uint16_t port = 0;
  std::optional<PrivateDaemon> daemon;
  for (int attempt = 0; attempt < 20 && !daemon; ++attempt) {  // others look for ports, too
    port = FreePorts(4);
    const std::string address = "tcp://127.0.0.1:" + std::to_string(port);
    Result<PrivateDaemon> started =
        PrivateDaemon::Start({.binary = B4MRL_BINARY_DIR "/b4mrl-serve",
                              .data_folder = EmptyDataFolder(),
                              .arguments = {"--workers", "2", "--bind", address}});
    if (port != 0 && started.ok()) daemon = std::move(*started);
  }
  REQUIRE(daemon);
  Client client = Connect("tcp://127.0.0.1:" + std::to_string(port));
  const RemoteEnvironment first = Take(client.Make("HalfCheetah"));
  const RemoteEnvironment second = Take(client.Make("HalfCheetah"));
  const std::set<uint32_t> workers = {first.in_force().port().tcp(),
                                      second.in_force().port().tcp()};
  CHECK(workers == std::set<uint32_t>{port + 1u, port + 2u});
  CHECK(client.hello().dataset_port().tcp() == port + 3u);
}

TEST_CASE("An ipc socket left by a killed daemon is taken over") {
  const TemporaryFolder folder;
  const std::string path = folder.File("socket");
  const std::string address = "ipc://" + path;
  {
    PrivateDaemon daemon = Start({"--workers", "1", "--bind", address});
    REQUIRE(Client::Connect(address).ok());
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

// A shell that executes `command`, in which $0 is the daemon's program and $1 a folder.
ProgramWithOutput StartShell(const std::string& command, const std::string& folder) {
  ProgramWithOutput shell;
  REQUIRE(StartWithOutput("sh", {"sh", "-c", command, B4MRL_BINARY_DIR "/b4mrl-serve", folder},
                          &shell) == 0);
  return shell;
}

int ExitCodeOf(const ProgramWithOutput& shell) {
  const int wait_status = WaitForExit(shell.process_id, Deadline::AfterMs(30'000));
  return WIFEXITED(wait_status) ? WEXITSTATUS(wait_status) : 128 + WTERMSIG(wait_status);
}

// All of it, or what came within half a minute.
std::string OutputOf(const ProgramWithOutput& shell) {
  const Deadline deadline = Deadline::AfterMs(30'000);
  std::string output;
  char c = 0;
  while (WaitUntilReady(shell.output.get(), POLLIN, deadline).ok() &&
         read(shell.output.get(), &c, 1) == 1) {
    output += c;
  }
  return output;
}

TEST_CASE("What the daemon cannot write is an error with a message and no signal") {
  const TemporaryFolder folder;
  const ProgramWithOutput limited = StartShell(
      "ulimit -f 8; exec \"$0\" --bind \"ipc://$1/socket\" --data \"$1\" 2>&1", folder.path());
  const std::string output = OutputOf(limited);
  CHECK(ExitCodeOf(limited) == 3);
  CHECK(output.find("File too large") != output.npos);
  for (const char* command :
       {"exec \"$0\" --help > /dev/full", "exec \"$0\" --no-such-option 2> /dev/full"}) {
    CAPTURE(command);
    CHECK(ExitCodeOf(StartShell(command, "")) == 3);
  }
}

// The sanitizers' shadow memory takes more than any limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_CASE("A daemon for which the system has too few threads ends with code 3 and says so") {
  const TemporaryFolder folder;
  // Stacks of 256 threads take 16 GiB of addresses; what every child has takes half of these 4.
  const ProgramWithOutput limited = StartShell(
      "ulimit -s 65536; ulimit -v 4194304; exec \"$0\" --workers 1 --threads 256 "
      "--bind \"ipc://$1/socket\" --data \"$1\" 2>&1",
      folder.path());
  const std::string output = OutputOf(limited);
  INFO(output);
  CHECK(ExitCodeOf(limited) == 3);
  CHECK(output.find("the system starts no more threads") != output.npos);
  CHECK(output.find("signal 6") == output.npos);
}
#endif

TEST_CASE("A daemon whose ready line could not be written serves, and ends with code 0") {
  const TemporaryFolder folder;
  const ProgramWithOutput daemon =
      StartShell("exec \"$0\" --bind \"ipc://$1/socket\" --data \"$1\" --workers 1 > /dev/full",
                 folder.path());
  CHECK(Connect("ipc://" + folder.File("socket")).Make("HalfCheetah").ok());
  REQUIRE(kill(daemon.process_id, SIGTERM) == 0);
  CHECK(ExitCodeOf(daemon) == 0);
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
