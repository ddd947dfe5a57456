#include "client/private_daemon.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <utility>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "proto/base/exit_codes.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

std::string FindBinary(const PrivateDaemonOptions& options) {
  if (!options.binary.empty()) return options.binary;
  if (const char* path = std::getenv("B4MRL_SERVER"); path != nullptr && *path != '\0') {
    const fs::path named(path);
    if (named.filename() != "b4mrl") return named;
    std::error_code ignored;  // the launcher, perhaps by a link, stands for the daemon beside it
    const fs::path launcher = fs::canonical(named, ignored);
    return (launcher.empty() ? named : launcher).parent_path() / "b4mrl-serve";
  }
  return ProgramBesideThisOne("b4mrl-serve");
}

std::vector<std::string> CommandLine(const PrivateDaemonOptions& options, const std::string& binary,
                                     const std::string& folder) {
  std::vector<std::string> words = {
      binary, "--bind", options.tcp ? "tcp://127.0.0.1:0" : "ipc://" + folder + "/serve"};
  const std::string data = options.no_data ? folder + "/data" : options.data_folder;
  if (!data.empty()) words.insert(words.end(), {"--data", data});
  // So the folder does not stay where this process is killed.
  if (!options.tcp) words.push_back("--own-folder");
  words.insert(words.end(), options.arguments.begin(), options.arguments.end());
  return words;
}

std::vector<std::string> Environment(const PrivateDaemonOptions& options) {
  std::vector<std::string> variables = EnvironmentWith(options.environment);
  // A command's private daemon logs warnings only, unless the user sets SPDLOG_LEVEL: getenv finds
  // the first variable of a name.
  variables.push_back("SPDLOG_LEVEL=warn");
  return variables;
}

// Between fork and exec: only async-signal-safe calls. The daemon gets no descriptor of this
// process but stderr, where the kernel can close them: its sockets and pipes would stay open with
// the daemon.
[[noreturn]] void RunChild(int output, pid_t parent, int niceness, const char* binary,
                           char* const* arguments, char* const* variables) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(127);  // the parent died before the line above
  // In a process group of its own, the daemon does not get a terminal's Ctrl-C; the command stops
  // it.
  setpgid(0, 0);
  (void)nice(niceness);
  TakeStreams(output, STDERR_FILENO);
  execve(binary, arguments, variables);
  _exit(127);
}

// The ENDPOINT of "ready ENDPOINT\n" on the child's stdout; "" if it ended or the deadline passed.
std::string AwaitReady(int output, const Deadline& deadline) {
  std::string text;
  while (!deadline.expired() && text.size() < 4096) {
    pollfd item = {output, POLLIN, 0};
    if (poll(&item, 1, static_cast<int>(deadline.remaining_ms())) <= 0) continue;
    char buffer[256];
    const ssize_t count = read(output, buffer, sizeof(buffer));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return "";
    text.append(buffer, static_cast<size_t>(count));
    const size_t start = text.find("ready ");
    const size_t end = start == std::string::npos ? start : text.find('\n', start);
    if (end != std::string::npos) return text.substr(start + 6, end - start - 6);
  }
  return "";
}

}  // namespace

Result<PrivateDaemon> PrivateDaemon::Start(const PrivateDaemonOptions& options) {
  const std::string binary = FindBinary(options);
  if (access(binary.c_str(), X_OK) != 0) {
    return Status(StatusCode::kUnavailable,
                  fmt::format("cannot run the server '{}': {}", binary, std::strerror(errno)));
  }
  PrivateDaemon daemon;
  if (!options.tcp) {
    B4MRL_ASSIGN_OR_RETURN(daemon.folder_, MakeTemporaryFolder("b4mrl"));
    const std::string data = daemon.folder_ + "/data";
    if (options.no_data && mkdir(data.c_str(), 0700) != 0) return IoError("make", data, errno);
  }
  std::vector<std::string> words = CommandLine(options, binary, daemon.folder_);
  std::vector<std::string> variables = Environment(options);
  const std::vector<char*> arguments = PointersTo(words);
  const std::vector<char*> environment = PointersTo(variables);
  int output[2];
  if (pipe2(output, O_CLOEXEC) != 0) return IoError("make", "a pipe", errno);
  const pid_t parent = getpid();
  daemon.process_id_ = fork();
  if (daemon.process_id_ == 0) {
    RunChild(output[1], parent, options.niceness, binary.c_str(), arguments.data(),
             environment.data());
  }
  const int fork_error = errno;
  close(output[1]);
  if (daemon.process_id_ < 0) {
    close(output[0]);
    return IoError("start", binary, fork_error);
  }
  daemon.endpoint_ = AwaitReady(output[0], Deadline::AfterMs(options.ready_deadline_ms));
  close(output[0]);
  if (daemon.endpoint_.empty()) {
    // A daemon that is about to exit keeps its own exit code.
    const int exit_status = daemon.Stop();
    if (WIFEXITED(exit_status) && WEXITSTATUS(exit_status) == kExitBadInput) {
      return Status(StatusCode::kIoError,
                    fmt::format("the server '{}' cannot use what it was given; its messages are on "
                                "stderr",
                                binary));
    }
    return Status(
        StatusCode::kUnavailable,
        fmt::format("the server '{}' did not get ready; its messages are on stderr", binary));
  }
  return daemon;
}

PrivateDaemon::PrivateDaemon(PrivateDaemon&& other) noexcept { *this = std::move(other); }

PrivateDaemon& PrivateDaemon::operator=(PrivateDaemon&& other) noexcept {
  std::swap(process_id_, other.process_id_);
  std::swap(endpoint_, other.endpoint_);
  std::swap(folder_, other.folder_);
  return *this;
}

PrivateDaemon::~PrivateDaemon() {
  Stop();
  std::error_code error;
  if (!folder_.empty()) fs::remove_all(folder_, error);
}

int PrivateDaemon::Stop(int64_t deadline_ms) {
  if (process_id_ <= 0) return 0;
  kill(process_id_, SIGTERM);
  const int exit_status = WaitForExit(process_id_, Deadline::AfterMs(deadline_ms));
  process_id_ = -1;
  return exit_status;
}

}  // namespace b4mrl
