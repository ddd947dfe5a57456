#include "server/supervisor/listeners.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <thread>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "proto/base/spec.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"

namespace b4mrl {
namespace {

constexpr int kBacklog = 1024;
constexpr int kSocketFlags = SOCK_CLOEXEC | SOCK_NONBLOCK;

Result<in_addr> ResolveHost(const std::string& host) {
  in_addr address{};
  if (host == "*") return in_addr{htonl(INADDR_ANY)};
  if (inet_pton(AF_INET, host.c_str(), &address) == 1) return address;
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0 || found == nullptr) {
    return InvalidArgument("host of --bind", host, "an IPv4 address or a name that has one");
  }
  address = reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr;
  freeaddrinfo(found);
  return address;
}

bool IsLoopback(in_addr address) { return ntohl(address.s_addr) >> 24 == 127; }

std::string FormatHost(in_addr address) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address, text, sizeof(text));
  return text;
}

// A socket of `type` that listens on `address`, which `name` names in errors.
Result<UniqueFd> Listen(int type, const sockaddr* address, socklen_t size,
                        const std::string& name) {
  UniqueFd fd(socket(address->sa_family, type | kSocketFlags, 0));
  if (!fd.valid()) return IoError("open a socket for", name, errno);
  const int on = 1;  // has an effect on TCP alone
  setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (bind(fd.get(), address, size) != 0 || listen(fd.get(), kBacklog) != 0) {
    return IoError("listen on", name, errno);
  }
  return fd;
}

enum class FileState { kNone, kNoSocket, kStale, kInUse };

// Whether a process listens on a socket file, or it was left by a daemon that was killed.
FileState StateOf(const sockaddr_un& address) {
  struct stat info {};
  if (lstat(address.sun_path, &info) != 0) return FileState::kNone;
  if (!S_ISSOCK(info.st_mode)) return FileState::kNoSocket;
  // Waits for nobody: where the queue of a stopped daemon is full, the answer is EAGAIN.
  const UniqueFd probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const auto* generic = reinterpret_cast<const sockaddr*>(&address);
  const bool is_refused =
      connect(probe.get(), generic, sizeof(address)) != 0 && errno == ECONNREFUSED;
  return is_refused ? FileState::kStale : FileState::kInUse;
}

constexpr int64_t kPatienceMs = 1000;
constexpr std::chrono::milliseconds kBetweenTries(10);

// Waits until nobody listens on a socket file, for a second at most: the children of a killed
// daemon end moments after it, and listen until then.
void AwaitEndOfListening(const sockaddr_un& address) {
  const Deadline patience = Deadline::AfterMs(kPatienceMs);
  while (StateOf(address) == FileState::kInUse && !patience.expired()) {
    std::this_thread::sleep_for(kBetweenTries);
  }
}

// A lock on the folder of a socket, in which daemons bind theirs and listen. Under it, a socket
// file that nobody listens on is one that was left, not one that another daemon has just bound, and
// no other daemon removes it first. Daemons hold it for a moment, so who still has it after a
// second is none and needs no heed. On a file system without locks there is none.
UniqueFd LockFolder(const std::string& folder) {
  UniqueFd fd(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  const Deadline patience = Deadline::AfterMs(kPatienceMs);
  while (fd.valid() && flock(fd.get(), LOCK_EX | LOCK_NB) != 0 &&
         (errno == EWOULDBLOCK || errno == EINTR) && !patience.expired()) {
    std::this_thread::sleep_for(kBetweenTries);
  }
  return fd;
}

sockaddr_un AddressOfFile(const std::string& checked_path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, checked_path.c_str(), checked_path.size() + 1);
  return address;
}

std::string ParentOf(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

// The parsed addresses of --bind.
struct Plan {
  struct Tcp {
    in_addr host;
    uint16_t port;
  };
  std::vector<Tcp> tcp;
  std::vector<std::string> ipc;
};

Result<Plan> ParseBinds(const std::vector<std::string>& binds, bool insecure) {
  Plan plan;
  for (const std::string& bind : binds) {
    if (bind.starts_with("ipc://")) {
      B4MRL_ASSIGN_OR_RETURN(std::string path, ParseIpcAddress(bind));
      // Clients are told the path and may run in another folder, so it is made absolute.
      std::error_code error;
      plan.ipc.push_back(std::filesystem::absolute(path, error));
      if (error) return IoError("resolve", path, error.value());
      continue;
    }
    const Result<TcpAddress> address = ParseTcpAddress(bind);
    if (!address.ok()) {
      return InvalidArgument("--bind", bind,
                             "tcp://HOST:PORT with a port in 0..65535 or ipc://PATH");
    }
    B4MRL_ASSIGN_OR_RETURN(const in_addr host, ResolveHost(address->host));
    if (!IsLoopback(host) && !insecure) {
      return Status(StatusCode::kFailedPrecondition,
                    fmt::format("--bind {} can be reached from other machines, and nothing "
                                "authenticates them yet; add --insecure to allow it",
                                bind));
    }
    plan.tcp.push_back({host, address->port});
  }
  return plan;
}

Status AddTcp(in_addr host, uint16_t port, std::vector<ListeningEndpoint>* to, uint32_t* told) {
  const std::string name = fmt::format("tcp://{}:{}", FormatHost(host), port);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr = host;
  address.sin_port = htons(port);
  socklen_t size = sizeof(address);
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  B4MRL_ASSIGN_OR_RETURN(UniqueFd fd, Listen(SOCK_STREAM, generic, size, name));
  if (getsockname(fd.get(), generic, &size) != 0) return IoError("listen on", name, errno);
  const uint16_t bound = ntohs(address.sin_port);
  to->push_back({fmt::format("tcp://{}:{}", FormatHost(host), bound), fd.Release()});
  if (told != nullptr && *told == 0) *told = bound;
  return Status();
}

Status AddIpc(const std::string& path, std::vector<ListeningEndpoint>* to,
              std::vector<SocketFile>* files) {
  const std::string name = "ipc://" + path;
  B4MRL_ASSIGN_OR_RETURN(const std::string checked, ParseIpcAddress(name));
  const sockaddr_un address = AddressOfFile(checked);
  AwaitEndOfListening(address);
  const UniqueFd lock = LockFolder(ParentOf(checked));
  const FileState state = StateOf(address);
  if (state == FileState::kStale) unlink(address.sun_path);
  if (state == FileState::kNoSocket) {
    return Status(StatusCode::kIoError,
                  fmt::format("cannot listen on {}: a file that is no socket is in the way", name));
  }
  const auto* generic = reinterpret_cast<const sockaddr*>(&address);
  B4MRL_ASSIGN_OR_RETURN(UniqueFd fd, Listen(SOCK_STREAM, generic, sizeof(address), name));
  struct stat info {};
  if (lstat(address.sun_path, &info) != 0) return IoError("listen on", name, errno);
  files->push_back({checked, info.st_dev, info.st_ino});
  to->push_back({name, fd.Release()});
  return Status();
}

// Adds to the error of a worker's port, which no user has named, why the daemon listens there.
Status ExplainWorkerPort(const Status& status, uint32_t base) {
  return Status(status.code(),
                fmt::format("{}; a daemon at port {} also takes the ports after it, one for each "
                            "worker and the next for datasets (--single-port: none)",
                            status.message(), base));
}

// Opens the listeners of one worker: at the gateway's port + `offset`, and at its ipc path followed
// by `suffix`.
Status AddWorker(const Plan& plan, uint32_t offset, const std::string& suffix,
                 std::vector<ListeningEndpoint>* to, ChildOptions::Port* told,
                 std::vector<SocketFile>* files) {
  if (!plan.tcp.empty()) {
    const uint32_t base = plan.tcp.front().port;
    if (base + offset > 65535) {
      return InvalidNumber("port of --bind", base, "room for the workers' ports below 65536");
    }
    std::vector<uint32_t> hosts_done;
    const bool is_everywhere = std::ranges::any_of(
        plan.tcp, [](const Plan::Tcp& tcp) { return tcp.host.s_addr == INADDR_ANY; });
    for (const Plan::Tcp& tcp : plan.tcp) {
      // A socket on all hosts leaves the port on none of them.
      if (is_everywhere && tcp.host.s_addr != INADDR_ANY) continue;
      if (std::count(hosts_done.begin(), hosts_done.end(), tcp.host.s_addr) > 0) continue;
      hosts_done.push_back(tcp.host.s_addr);
      // Every host gets the port of the first host, because clients are told one number.
      const uint32_t port = base == 0 ? told->tcp : base + offset;
      const Status added = AddTcp(tcp.host, static_cast<uint16_t>(port), to, &told->tcp);
      if (!added.ok() && base != 0) return ExplainWorkerPort(added, base);
      B4MRL_RETURN_IF_ERROR(added);
    }
  }
  if (!plan.ipc.empty()) {
    told->ipc = plan.ipc.front() + suffix;
    B4MRL_RETURN_IF_ERROR(AddIpc(told->ipc, to, files));
  }
  return Status();
}

// Opens the listeners of all workers and of the dataset worker.
Status FillWorkers(const Plan& plan, uint32_t workers, Listeners* listeners) {
  listeners->workers.resize(workers);
  listeners->worker_ports.resize(workers);
  for (uint32_t i = 0; i < workers; ++i) {
    B4MRL_RETURN_IF_ERROR(AddWorker(plan, i + 1, fmt::format(".worker-{}", i),
                                    &listeners->workers[i], &listeners->worker_ports[i],
                                    &listeners->socket_files));
  }
  return AddWorker(plan, workers + 1, ".dataset", &listeners->dataset, &listeners->dataset_port,
                   &listeners->socket_files);
}

// Opens the local doors of all workers.
Status FillDoors(Listeners* listeners) {
  uint64_t drawn[2] = {};
  (void)!getrandom(drawn, sizeof(drawn), 0);  // never shortened (getrandom(2))
  for (size_t i = 0; i < listeners->workers.size(); ++i) {
    const std::string name = fmt::format("b4mrl-{:016x}{:016x}.worker-{}", drawn[0], drawn[1], i);
    sockaddr_un address;
    const socklen_t size = DoorAddress(name, &address);
    const auto* generic = reinterpret_cast<const sockaddr*>(&address);
    B4MRL_ASSIGN_OR_RETURN(UniqueFd fd, Listen(SOCK_SEQPACKET, generic, size, "door " + name));
    listeners->doors.push_back(fd.Release());
    listeners->worker_ports[i].door = name;
  }
  return Status();
}

// Makes the folder of the socket `path` the daemon's if it has the name of those that clients make,
// and its data folder too if that is the one in it which PrivateDaemon makes
// (client/private_daemon.h): any other holds data of the user's.
void OwnFolderOf(const std::string& path, const std::string& data_folder, Listeners* listeners) {
  const std::string folder = ParentOf(path);
  if (!std::filesystem::path(folder).filename().string().starts_with("b4mrl-")) return;
  listeners->private_folder = folder;
  const std::string data = listeners->private_folder + "/data";
  listeners->private_data = data_folder == data ? data : "";
}

// Of the folder for the workers' sockets where no client is told of them.
constexpr std::string_view kRelayFolder = "b4mrl-gateway";

// Removes a folder if it is this user's and holds nothing but sockets that nobody listens on.
void RemoveIfLeft(const std::filesystem::path& folder) {
  struct stat info {};
  if (lstat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode) || info.st_uid != geteuid()) {
    return;
  }
  const UniqueFd lock = LockFolder(folder);
  std::vector<sockaddr_un> left;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    const std::string path = it->path();
    if (path.size() >= sizeof(sockaddr_un::sun_path)) return;
    left.push_back(AddressOfFile(path));
    if (StateOf(left.back()) != FileState::kStale) return;
  }
  if (error || left.empty()) return;  // without sockets, its daemon may be about to bind them
  for (const sockaddr_un& address : left) unlink(address.sun_path);
  rmdir(folder.c_str());
}

// Removes what killed daemons with --single-port have left in `parent`.
void RemoveLeftRelayFolders(const std::string& parent) {
  const std::string prefix = fmt::format("{}-", kRelayFolder);
  std::error_code error;
  for (std::filesystem::directory_iterator it(parent, error), end; !error && it != end;
       it.increment(error)) {
    const std::string name = it->path().filename();
    if (name.starts_with(prefix)) RemoveIfLeft(it->path());
  }
}

Status Fill(Plan plan, const ServeOptions& options, Listeners* listeners) {
  for (const Plan::Tcp& tcp : plan.tcp) {
    B4MRL_RETURN_IF_ERROR(AddTcp(tcp.host, tcp.port, &listeners->gateway, nullptr));
    listeners->loopback_only &= IsLoopback(tcp.host);
  }
  for (const std::string& path : plan.ipc) {
    B4MRL_RETURN_IF_ERROR(AddIpc(path, &listeners->gateway, &listeners->socket_files));
  }
  // Of the first alone: the user may have added others, in folders of their own.
  if (options.own_folder && !plan.ipc.empty()) {
    OwnFolderOf(plan.ipc.front(), options.data_folder, listeners);
  }
  if (!options.single_port) {
    B4MRL_RETURN_IF_ERROR(FillWorkers(plan, options.workers, listeners));
    return options.no_door ? Status() : FillDoors(listeners);
  }
  plan.tcp.clear();
  if (plan.ipc.empty()) {
    B4MRL_ASSIGN_OR_RETURN(listeners->private_folder, MakeTemporaryFolder(kRelayFolder));
    RemoveLeftRelayFolders(ParentOf(listeners->private_folder));
    plan.ipc = {listeners->private_folder + "/relay"};
  }
  B4MRL_RETURN_IF_ERROR(FillWorkers(plan, options.workers, listeners));
  for (ChildOptions::Port& port : listeners->worker_ports) port = {};
  listeners->dataset_port = {};
  return Status();
}

}  // namespace

Result<Listeners> OpenListeners(const ServeOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(Plan plan, ParseBinds(options.binds, options.insecure));
  Listeners listeners;
  if (Status status = Fill(std::move(plan), options, &listeners); !status.ok()) {
    RemoveSocketFiles(listeners);  // the process is about to end; descriptors go with it
    return status;
  }
  return listeners;
}

std::string LocalAddress(const ListeningEndpoint& endpoint) {
  constexpr std::string_view kAnyHost = "tcp://0.0.0.0:";
  if (!endpoint.address.starts_with(kAnyHost)) return endpoint.address;
  return "tcp://127.0.0.1:" + endpoint.address.substr(kAnyHost.size());
}

void RemoveSocketFiles(const Listeners& listeners) {
  for (const SocketFile& file : listeners.socket_files) {
    struct stat info {};
    const bool is_ours = lstat(file.path.c_str(), &info) == 0 && info.st_dev == file.device &&
                         info.st_ino == file.inode;
    if (is_ours) unlink(file.path.c_str());
  }
  std::error_code error;
  if (!listeners.private_data.empty()) std::filesystem::remove_all(listeners.private_data, error);
  if (!listeners.private_folder.empty()) rmdir(listeners.private_folder.c_str());
}

}  // namespace b4mrl
