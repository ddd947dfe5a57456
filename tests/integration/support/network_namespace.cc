#include "tests/integration/support/network_namespace.h"

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

std::set<std::string> SocketInodes(pid_t process) {
  std::set<std::string> inodes;
  for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(process) + "/fd")) {
    std::error_code error;
    const std::string target = fs::read_symlink(entry.path(), error).string();
    constexpr std::string_view kPrefix = "socket:[";
    if (!target.starts_with(kPrefix)) continue;
    inodes.insert(target.substr(kPrefix.size(), target.size() - kPrefix.size() - 1));
  }
  return inodes;
}

bool RaiseLoopback() {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request{};
  std::strncpy(request.ifr_name, "lo", IFNAMSIZ - 1);
  request.ifr_flags = IFF_UP;
  const bool raised = ioctl(fd, SIOCSIFFLAGS, &request) == 0;
  close(fd);
  return raised;
}

}  // namespace

std::set<uint16_t> ListeningPorts(pid_t process) {
  const std::set<std::string> inodes = SocketInodes(process);
  std::set<uint16_t> ports;
  std::ifstream table("/proc/net/tcp");
  for (std::string line; std::getline(table, line);) {
    std::istringstream words(line);
    const std::vector<std::string> columns{std::istream_iterator<std::string>(words), {}};
    constexpr char kListening[] = "0A";
    if (columns.size() < 10 || columns[3] != kListening || !inodes.contains(columns[9])) continue;
    const std::string port = columns[1].substr(columns[1].find(':') + 1);
    ports.insert(static_cast<uint16_t>(std::stoul(port, nullptr, 16)));
  }
  return ports;
}

pid_t RunIsolated(const std::function<int(int channel)>& body, int* parent_channel) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return -1;
  const pid_t child = fork();
  if (child != 0) {
    close(ends[1]);
    *parent_channel = ends[0];
    return child;
  }
  close(ends[0]);
  // An unprivileged user gets a network namespace only within a user namespace.
  const bool isolated =
      (unshare(CLONE_NEWNET) == 0 || unshare(CLONE_NEWUSER | CLONE_NEWNET) == 0) && RaiseLoopback();
  const int exit_code = isolated ? body(ends[1]) : kNoNamespaces;
  std::fflush(nullptr);
  _exit(exit_code);
}

}  // namespace b4mrl
