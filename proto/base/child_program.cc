#include "proto/base/child_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>

extern char** environ;

namespace b4mrl {

std::string ThisProgram() {
  std::array<char, PATH_MAX> path{};
  const ssize_t length = readlink("/proc/self/exe", path.data(), path.size());
  return {path.data(), length > 0 ? static_cast<size_t>(length) : 0};
}

std::string ProgramBesideThisOne(std::string_view name) {
  const std::string own = ThisProgram();
  return own.substr(0, own.rfind('/') + 1).append(name);
}

std::vector<std::string> EnvironmentWith(const std::vector<std::string>& added) {
  std::vector<std::string> variables = added;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string_view name(*entry, std::strcspn(*entry, "="));
    const bool is_replaced = std::ranges::any_of(
        added, [&](const std::string_view text) { return text.substr(0, text.find('=')) == name; });
    if (!is_replaced) variables.emplace_back(*entry);
  }
  return variables;
}

std::vector<char*> PointersTo(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

namespace {

// Makes `from` the descriptor `to`, which a program that is started keeps.
void Place(int from, int to) {
  if (from == to) {
    fcntl(to, F_SETFD, 0);  // which dup2 would leave as it is
  } else {
    dup2(from, to);
  }
}

}  // namespace

void TakeStreams(int output, int errors, int kept) {
  Place(errors, STDERR_FILENO);
  Place(output, STDOUT_FILENO);
  const int nothing = open("/dev/null", O_RDONLY);
  Place(nothing, STDIN_FILENO);
  const bool keeps = kept > STDERR_FILENO;
  if (keeps) {
    fcntl(kept, F_SETFD, 0);
    if (kept > STDERR_FILENO + 1) close_range(STDERR_FILENO + 1, kept - 1, 0);
  }
  close_range((keeps ? kept : STDERR_FILENO) + 1, ~0u, 0);
}

namespace {

// Starts a program with these descriptors as its stdin and stdout, and no other beside stderr.
// `flags` are those of posix_spawnattr_setflags, to which this adds one. Returns 0 or an errno.
int Spawn(const std::string& program, std::vector<std::string> words, char* const* variables,
          int input, int output, short flags, pid_t* process_id) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // This program may ignore it (RunProgram); others are to have it as their user set it up.
  sigset_t own;
  sigemptyset(&own);
  sigaddset(&own, SIGXFSZ);
  posix_spawnattr_setsigdefault(&attributes, &own);
  posix_spawnattr_setflags(&attributes, static_cast<short>(flags | POSIX_SPAWN_SETSIGDEF));
  const std::vector<char*> argv = PointersTo(words);
  const int error =
      posix_spawnp(process_id, program.c_str(), &actions, &attributes, argv.data(), variables);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace

int StartOnSocket(const std::string& program, std::vector<std::string> words,
                  ProgramOnSocket* started) {
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) return errno;
  started->socket = UniqueFd(ends[0]);
  const UniqueFd theirs(ends[1]);
  return Spawn(program, std::move(words), environ, theirs.get(), STDERR_FILENO, 0,
               &started->process_id);
}

int StartWithOutput(const std::string& program, std::vector<std::string> words,
                    ProgramWithOutput* started, std::optional<std::vector<std::string>> variables) {
  const UniqueFd nothing(open("/dev/null", O_RDONLY | O_CLOEXEC));
  std::array<int, 2> ends{};
  if (!nothing.valid() || pipe2(ends.data(), O_CLOEXEC) != 0) return errno;
  started->output = UniqueFd(ends[0]);
  const UniqueFd theirs(ends[1]);
  const std::vector<char*> own = variables ? PointersTo(*variables) : std::vector<char*>();
  return Spawn(program, std::move(words), variables ? own.data() : environ, nothing.get(),
               theirs.get(), POSIX_SPAWN_SETPGROUP, &started->process_id);
}

Status WaitUntilReady(int fd, short events, const Deadline& deadline) {
  pollfd waiting{fd, events, 0};
  while (true) {
    const int64_t left_ms = std::min<int64_t>(deadline.remaining_ms(), INT_MAX);
    if (poll(&waiting, 1, static_cast<int>(left_ms)) > 0) return Status();
    if (deadline.expired()) return Status(StatusCode::kDeadlineExceeded, "no answer in time");
  }
}

Status SendAll(int socket, std::span<const std::byte> bytes, const Deadline& deadline) {
  while (!bytes.empty()) {
    const ssize_t sent = send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent > 0) {
      bytes = bytes.subspan(static_cast<size_t>(sent));
    } else if (errno == EAGAIN) {
      B4MRL_RETURN_IF_ERROR(WaitUntilReady(socket, POLLOUT, deadline));
    } else if (errno != EINTR) {
      return Status(StatusCode::kUnavailable, "the other end is gone");
    }
  }
  return Status();
}

int WaitForExit(pid_t child, const Deadline& deadline) {
  const UniqueFd handle(static_cast<int>(syscall(SYS_pidfd_open, child, 0)));
  int wait_status = 0;
  // Without a pidfd (a sandbox may forbid pidfd_open), test every kLookMs whether the child ended.
  while (handle.get() < 0 && !deadline.expired()) {
    constexpr int kLookMs = 10;
    if (waitpid(child, &wait_status, WNOHANG) == child) return wait_status;
    poll(nullptr, 0, kLookMs);
  }
  const bool has_ended = handle.get() >= 0 && WaitUntilReady(handle.get(), POLLIN, deadline).ok();
  if (!has_ended) kill(child, SIGKILL);
  while (waitpid(child, &wait_status, 0) < 0 && errno == EINTR) {
  }
  return wait_status;
}

Result<std::string> MakeTemporaryFolder(std::string_view name) {
  constexpr size_t kRoomForNames = 48;  // "/b4mrl-gateway-XXXXXX/serve.worker-63" and more
  const char* const set = std::getenv("TMPDIR");
  std::string_view base = set == nullptr ? "" : set;
  if (base.empty() || base.size() + kRoomForNames >= sizeof(sockaddr_un::sun_path)) base = "/tmp";
  std::string path = fmt::format("{}/{}-XXXXXX", base, name);
  if (mkdtemp(path.data()) == nullptr) return IoError("make the folder", path, errno);
  return path;
}

FolderRemover::~FolderRemover() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace b4mrl
