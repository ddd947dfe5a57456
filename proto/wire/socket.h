// The only door to ZeroMQ: a ROUTER for servers, a DEALER for clients, and waiting on them.
//
// All waits are bounded, all queues have a high-water mark, a server's also a bound in bytes,
// messages are capped, heartbeats run on every connection, and a message that cannot be queued
// towards a peer is an error of the call rather than lost in silence. Thread rule: a socket belongs
// to the thread that made it. A Context may be shared.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "proto/wire/unread_bytes.h"

namespace b4mrl {

// Owns the input/output thread. Outlives its sockets.
class Context {
 public:
  Context();
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
  void* handle() const { return handle_; }

 private:
  void* handle_;
};

// Where a server listens: an address ("tcp://127.0.0.1:7700", "ipc:///run/b4mrl.sock") and, where
// somebody else bound it already, the listening file descriptor to accept on (-1: bind it here).
struct ListeningEndpoint {
  std::string address;
  int fd = -1;
};

// Who sent a message; opaque bytes that ZeroMQ chose, valid while the connection lives.
using RoutingId = std::string;

struct IncomingMessage {
  RoutingId sender;
  Message message;
};

class RouterSocket {
 public:
  static Result<RouterSocket> Bind(Context& context, std::span<const ListeningEndpoint> endpoints);
  RouterSocket(RouterSocket&&) noexcept;
  RouterSocket& operator=(RouterSocket&&) noexcept;
  ~RouterSocket();

  // The next message if one is there. Messages of more than two parts after the routing id have
  // their surplus dropped and arrive with `message.payload` empty and `message.envelope` empty,
  // which no parser accepts, so that their sender is answered with an error.
  std::optional<IncomingMessage> TryReceive();
  // Never blocks. kUnavailable: the peer has gone; kLimitExceeded: it does not read its replies.
  Status Send(const RoutingId& receiver, Message message);
  // Lets what was sent leave for up to `linger_ms` when the socket closes; else it is dropped.
  void LingerOnClose(int64_t linger_ms);
  void* handle() const { return socket_; }

 private:
  explicit RouterSocket(void* socket) : socket_(socket) {}
  void* socket_ = nullptr;
  UnreadBytes unread_;
};

class DealerSocket {
 public:
  // Returns at once; the connection is made, and made again, in the background.
  static Result<DealerSocket> Connect(Context& context, const std::string& address);
  DealerSocket(DealerSocket&&) noexcept;
  DealerSocket& operator=(DealerSocket&&) noexcept;
  ~DealerSocket();

  // Never blocks. kUnavailable when the queue towards the server is full.
  Status Send(Message message);
  std::optional<Message> TryReceive();
  // Blocks for the next message until the deadline, but at most 20 ms, after which the caller may
  // look at connections(). Takes fewer system calls than Wait and TryReceive.
  std::optional<Message> Receive(const Deadline& deadline);
  // Waits for a message, a (re)connection or the deadline; true when TryReceive may have something
  // or connections() may have grown.
  bool Wait(const Deadline& deadline);
  // Completed handshakes so far: more than before means that whatever an earlier peer held is lost.
  uint32_t connections();
  void* handle() const { return socket_; }
  // Readable when connections() may have grown: to be waited on, nothing else.
  void* monitor_handle() const { return monitor_; }

 private:
  DealerSocket(void* socket, void* monitor) : socket_(socket), monitor_(monitor) {}
  void* socket_ = nullptr;
  void* monitor_ = nullptr;
  uint32_t connections_ = 0;
  int receive_timeout_ms_ = -1;
};

// Waits until the socket or one of `fds` is readable or the time is over. Returns true when the
// socket is; sets fd_ready[i] (if given) for the descriptors.
bool WaitReadable(void* socket, std::span<const int> fds, int64_t timeout_ms,
                  std::vector<bool>* fd_ready = nullptr);

// Waits until one of the sockets or descriptors is readable or the time is over.
void WaitAnyReadable(std::span<void* const> sockets, int64_t timeout_ms,
                     std::span<const int> fds = {});

// "tcp://host:port" into its parts; anything else is refused with what is allowed.
struct TcpAddress {
  std::string host;
  uint16_t port = 0;
};
Result<TcpAddress> ParseTcpAddress(std::string_view address);
// "ipc:///path" gives the path, which must fit sockaddr_un.
Result<std::string> ParseIpcAddress(std::string_view address);

}  // namespace b4mrl
