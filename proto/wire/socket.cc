#include "proto/wire/socket.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <sys/random.h>
#include <sys/un.h>
#include <zmq.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "proto/base/limits.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

constexpr int64_t kLongestBlockMs = 20;  // longest wait of DealerSocket::Receive
// Messages that a DEALER holds before its thread takes them, each of up to 64 MiB: twice the
// requests that a session may have in flight.
constexpr int kUnreadReplies = 2 * limits::kMaxRequestsInFlight;

zmq_msg_t* AsZmq(Frame& frame) { return static_cast<zmq_msg_t*>(frame.handle()); }

void SetInt(void* socket, int option, int value) {
  zmq_setsockopt(socket, option, &value, sizeof(value));
}

// Sets the limits that all sockets of the project have, of servers and of clients.
void SetCommonOptions(void* socket) {
  const int64_t max_message = limits::kMaxPayloadBytes;
  zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &max_message, sizeof(max_message));
  SetInt(socket, ZMQ_LINGER, 0);
  SetInt(socket, ZMQ_SNDHWM, limits::kHighWaterMark);
  SetInt(socket, ZMQ_RCVHWM, limits::kHighWaterMark);
  SetInt(socket, ZMQ_HANDSHAKE_IVL, limits::kHandshakeMs);
  SetInt(socket, ZMQ_HEARTBEAT_IVL, limits::kHeartbeatIntervalMs);
  SetInt(socket, ZMQ_HEARTBEAT_TIMEOUT, limits::kHeartbeatTimeoutMs);
  SetInt(socket, ZMQ_HEARTBEAT_TTL, limits::kHeartbeatTtlMs);
}

bool HasMore(Frame& frame) { return zmq_msg_more(AsZmq(frame)) != 0; }

bool ReceivePart(void* socket, Frame& frame) {
  while (zmq_msg_recv(AsZmq(frame), socket, ZMQ_DONTWAIT) < 0) {
    if (errno != EINTR) return false;
  }
  return true;
}

// Reads the parts that follow the `parts` of a message that were read; surplus parts empty the
// message (see the header).
Message ReceiveRest(void* socket, Message message, size_t parts, bool more) {
  for (; more; ++parts) {
    Frame part;
    if (!ReceivePart(socket, part)) break;  // cannot happen: parts arrive together
    more = HasMore(part);
    if (parts == 0) message.envelope = std::move(part);
    if (parts == 1) message.payload = std::move(part);
  }
  return parts > limits::kMaxFramesPerMessage ? Message() : std::move(message);
}

bool SendPart(void* socket, Frame& frame, int flags) {
  while (zmq_msg_send(AsZmq(frame), socket, flags | ZMQ_DONTWAIT) < 0) {
    if (errno != EINTR) return false;
  }
  return true;
}

bool SendBody(void* socket, Message& message) {
  const bool has_payload = message.payload.size() > 0;
  if (!SendPart(socket, message.envelope, has_payload ? ZMQ_SNDMORE : 0)) return false;
  return !has_payload || SendPart(socket, message.payload, 0);
}

Status ZmqError(std::string_view action, std::string_view address) {
  return Status(StatusCode::kIoError,
                fmt::format("cannot {} {}: {}", action, address, zmq_strerror(zmq_errno())));
}

// Whether a network interface of this machine has the address.
bool IsOwnAddress(in_addr address) {
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return false;
  bool found = false;
  for (const ifaddrs* entry = all; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    found |=
        reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr.s_addr == address.s_addr;
  }
  freeifaddrs(all);
  return found;
}

// ZeroMQ numbers a ROUTER's peers from a number of the C library's generator on, and aborts if a
// peer has claimed the next number as its identity. So the first number must not be known, as it is
// while nobody has seeded that generator.
void SeedFirstRoutingId() {
  static const unsigned seed = [] {
    unsigned random = 0;
    if (getrandom(&random, sizeof(random), GRND_NONBLOCK) != sizeof(random)) {
      random = static_cast<unsigned>(Clock::now().time_since_epoch().count());
    }
    srand(random);
    return random;
  }();
  static_cast<void>(seed);
}

}  // namespace

Context::Context() : handle_(zmq_ctx_new(), zmq_ctx_term) {
  zmq_ctx_set(handle(), ZMQ_MAX_SOCKETS, 65535);
}

bool CameFromThisMachine(Message& message) {
  // An address in digits over tcp, "localhost:user:group:process" over ipc.
  const char* const peer = zmq_msg_gets(AsZmq(message.envelope), "Peer-Address");
  if (peer == nullptr) return false;
  if (std::string_view(peer).starts_with("localhost:")) return true;
  in_addr address{};
  if (inet_pton(AF_INET, peer, &address) != 1) return false;
  return ntohl(address.s_addr) >> 24 == IN_LOOPBACKNET || IsOwnAddress(address);
}

Result<RouterSocket> RouterSocket::Bind(const Context& context,
                                        std::span<const ListeningEndpoint> endpoints,
                                        UnreadLimits unread) {
  SeedFirstRoutingId();
  RouterSocket router(context, zmq_socket(context.handle(), ZMQ_ROUTER), unread);
  if (router.socket_ == nullptr) return ZmqError("create", "a socket");
  SetCommonOptions(router.socket_);
  SetInt(router.socket_, ZMQ_ROUTER_MANDATORY, 1);
  for (const ListeningEndpoint& endpoint : endpoints) {
    SetInt(router.socket_, ZMQ_USE_FD, endpoint.fd);
    if (zmq_bind(router.socket_, endpoint.address.c_str()) != 0) {
      return ZmqError("listen on", endpoint.address);
    }
  }
  return router;
}

RouterSocket::RouterSocket(RouterSocket&& other) noexcept
    : context_(std::move(other.context_)),
      socket_(std::exchange(other.socket_, nullptr)),
      unread_(std::move(other.unread_)) {}
RouterSocket& RouterSocket::operator=(RouterSocket&& other) noexcept {
  std::swap(context_, other.context_);
  std::swap(socket_, other.socket_);
  std::swap(unread_, other.unread_);
  return *this;
}
RouterSocket::~RouterSocket() {
  if (socket_ != nullptr) zmq_close(socket_);
}

std::optional<IncomingMessage> RouterSocket::TryReceive() {
  Frame id;
  if (!ReceivePart(socket_, id)) return std::nullopt;
  IncomingMessage incoming;
  incoming.sender.assign(id.view());
  incoming.message = ReceiveRest(socket_, Message(), 0, HasMore(id));
  return incoming;
}

Status RouterSocket::Send(const RoutingId& receiver, Message message) {
  B4MRL_RETURN_IF_ERROR(unread_.Count(receiver, &message));
  Frame id = Frame::Copy(receiver);
  if (!SendPart(socket_, id, ZMQ_SNDMORE)) {
    if (errno == EHOSTUNREACH) return Status(StatusCode::kUnavailable, "the peer has gone");
    return Status(StatusCode::kLimitExceeded, "the peer does not read its replies");
  }
  // Once the routing id was accepted, the pipe takes the rest of the message.
  if (!SendBody(socket_, message)) return ZmqError("send", "a reply");
  return Status();
}

void RouterSocket::LingerOnClose(int64_t linger_ms) {
  SetInt(socket_, ZMQ_LINGER, static_cast<int>(linger_ms));
}

Result<DealerSocket> DealerSocket::Connect(const Context& context, const std::string& address) {
  if (address.starts_with("tcp://[")) {  // ZeroMQ would take it and never connect
    return InvalidArgument("endpoint", address,
                           "tcp://HOST:PORT, where HOST is a name or an IPv4 address, or "
                           "ipc:///PATH");
  }
  static std::atomic<uint64_t> monitor_number{0};
  void* socket = zmq_socket(context.handle(), ZMQ_DEALER);
  if (socket == nullptr) return ZmqError("create", "a socket");
  SetCommonOptions(socket);
  SetInt(socket, ZMQ_RCVHWM, kUnreadReplies);
  SetInt(socket, ZMQ_RECONNECT_IVL, 5);
  SetInt(socket, ZMQ_RECONNECT_IVL_MAX, 200);
  const std::string monitor_address = fmt::format("inproc://monitor-{}", monitor_number++);
  zmq_socket_monitor(socket, monitor_address.c_str(), ZMQ_EVENT_HANDSHAKE_SUCCEEDED);
  void* monitor = zmq_socket(context.handle(), ZMQ_PAIR);
  SetInt(monitor, ZMQ_LINGER, 0);
  DealerSocket dealer(context, socket, monitor);
  if (zmq_connect(monitor, monitor_address.c_str()) != 0) return ZmqError("watch", address);
  if (zmq_connect(socket, address.c_str()) != 0) {
    return InvalidArgument("endpoint", address, "tcp://HOST:PORT or ipc:///PATH");
  }
  return dealer;
}

DealerSocket::DealerSocket(DealerSocket&& other) noexcept
    : context_(std::move(other.context_)),
      socket_(std::exchange(other.socket_, nullptr)),
      monitor_(std::exchange(other.monitor_, nullptr)),
      connections_(other.connections_),
      receive_timeout_ms_(other.receive_timeout_ms_) {}
DealerSocket& DealerSocket::operator=(DealerSocket&& other) noexcept {
  std::swap(context_, other.context_);
  std::swap(socket_, other.socket_);
  std::swap(monitor_, other.monitor_);
  std::swap(connections_, other.connections_);
  std::swap(receive_timeout_ms_, other.receive_timeout_ms_);
  return *this;
}
DealerSocket::~DealerSocket() {
  if (socket_ != nullptr) {
    zmq_socket_monitor(socket_, nullptr, 0);
    zmq_close(socket_);
  }
  if (monitor_ != nullptr) zmq_close(monitor_);
}

Status DealerSocket::Send(Message message) {
  if (!SendBody(socket_, message)) {
    return Status(StatusCode::kUnavailable, "the queue towards the server is full");
  }
  return Status();
}

std::optional<Message> DealerSocket::TryReceive() {
  Frame first;
  if (!ReceivePart(socket_, first)) return std::nullopt;
  const bool more = HasMore(first);
  return ReceiveRest(socket_, {std::move(first), Frame()}, 1, more);
}

std::optional<Message> DealerSocket::Receive(const Deadline& deadline) {
  const int timeout_ms =
      static_cast<int>(std::min<int64_t>(deadline.remaining_ms(), kLongestBlockMs));
  if (timeout_ms != receive_timeout_ms_) {
    SetInt(socket_, ZMQ_RCVTIMEO, timeout_ms);
    receive_timeout_ms_ = timeout_ms;
  }
  Frame first;
  if (zmq_msg_recv(AsZmq(first), socket_, 0) < 0) return std::nullopt;
  const bool more = HasMore(first);
  return ReceiveRest(socket_, {std::move(first), Frame()}, 1, more);
}

bool DealerSocket::Wait(const Deadline& deadline) {
  zmq_pollitem_t items[] = {{socket_, 0, ZMQ_POLLIN, 0}, {monitor_, 0, ZMQ_POLLIN, 0}};
  return zmq_poll(items, 2, static_cast<long>(deadline.remaining_ms())) > 0;
}

uint32_t DealerSocket::connections() {
  // Each event is a message of two frames. The monitor subscribes to handshakes alone, so the
  // number of messages is the number of handshakes.
  Frame event;
  while (ReceivePart(monitor_, event)) {
    if (!HasMore(event)) ++connections_;
  }
  return connections_;
}

bool WaitAnyReadable(std::span<void* const> sockets, int64_t timeout_ms, std::span<const int> fds) {
  std::vector<zmq_pollitem_t> items;
  for (void* socket : sockets) items.push_back({socket, 0, ZMQ_POLLIN, 0});
  for (const int fd : fds) items.push_back({nullptr, fd, ZMQ_POLLIN, 0});
  return zmq_poll(items.data(), static_cast<int>(items.size()), static_cast<long>(timeout_ms)) > 0;
}

Result<TcpAddress> ParseTcpAddress(std::string_view address) {
  constexpr std::string_view kPrefix = "tcp://";
  const size_t colon = address.rfind(':');
  if (!address.starts_with(kPrefix) || colon < kPrefix.size()) {
    return InvalidArgument("address", address, "tcp://HOST:PORT");
  }
  TcpAddress result;
  result.host = std::string(address.substr(kPrefix.size(), colon - kPrefix.size()));
  B4MRL_ASSIGN_OR_RETURN(const uint64_t port,
                         ParseUnsigned("port", address.substr(colon + 1), 0, 65535));
  result.port = static_cast<uint16_t>(port);
  if (result.host.empty()) return InvalidArgument("address", address, "tcp://HOST:PORT");
  return result;
}

Result<std::string> ParseIpcAddress(std::string_view address) {
  constexpr std::string_view kPrefix = "ipc://";
  const size_t longest = sizeof(sockaddr_un::sun_path) - 1;
  if (!address.starts_with(kPrefix) || address.size() == kPrefix.size() ||
      address.size() - kPrefix.size() > longest) {
    return InvalidArgument("address", address,
                           fmt::format("ipc://PATH with a path of at most {} bytes", longest));
  }
  return std::string(address.substr(kPrefix.size()));
}

}  // namespace b4mrl
