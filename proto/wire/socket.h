// The project's only use of ZeroMQ: a ROUTER for servers, a DEALER for clients, and waits for them.
//
// All waits are bounded, all queues have a high-water mark, a server's queues also a limit in
// bytes, message sizes are limited, heartbeats run on every connection, and a message that cannot
// be queued towards a peer is an error of the call rather than lost in silence. Thread rule: a
// socket belongs to the thread that made it. Threads may share a Context.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/frame.h"
#include "proto/wire/unread_bytes.h"

namespace b4mrl {

// A handle of ZeroMQ's input/output thread. Copies name the same thread, and every socket keeps
// one, so the thread ends with the last of them, in whatever order they end.
class Context {
 public:
  Context();
  void* handle() const { return handle_.get(); }

 private:
  std::shared_ptr<void> handle_;
};

// Where a server listens: an address ("tcp://127.0.0.1:7700", "ipc:///run/b4mrl.sock") and, if
// another process has bound it already, the listening file descriptor (-1: Bind binds the address).
struct ListeningEndpoint {
  std::string address;
  int fd = -1;
};

// The sender of a message: opaque bytes that ZeroMQ chose, valid while the connection lives.
using RoutingId = std::string;

struct IncomingMessage {
  RoutingId sender;
  Message message;
};

// Whether the peer that sent a message connected from this machine, as far as the socket can see: a
// tunnel that ends here looks local, too. For messages of a RouterSocket.
bool CameFromThisMachine(Message& message);

class RouterSocket {
 public:
  static Result<RouterSocket> Bind(const Context& context,
                                   std::span<const ListeningEndpoint> endpoints,
                                   UnreadLimits unread = {});
  RouterSocket(RouterSocket&&) noexcept;
  RouterSocket& operator=(RouterSocket&&) noexcept;
  ~RouterSocket();

  // The next message, if a message has arrived. A message of more than two parts after the routing
  // id is returned with an empty envelope and an empty payload, which no parser accepts, so that
  // its sender is answered with an error.
  std::optional<IncomingMessage> TryReceive();
  // Never blocks. kUnavailable: the peer has gone; kLimitExceeded: the peer does not read its
  // replies.
  Status Send(const RoutingId& receiver, Message message);
  // After the socket closes, ZeroMQ goes on sending queued messages for up to `linger_ms`, then
  // drops them. Without this call it drops them at once.
  void LingerOnClose(int64_t linger_ms);
  void* handle() const { return socket_; }
  const UnreadBytes& unread() const { return unread_; }

 private:
  RouterSocket(Context context, void* socket, UnreadLimits unread)
      : context_(std::move(context)), socket_(socket), unread_(unread) {}
  Context context_;
  void* socket_ = nullptr;
  UnreadBytes unread_;
};

class DealerSocket {
 public:
  // Returns at once; ZeroMQ connects, and after a break reconnects, in the background.
  static Result<DealerSocket> Connect(const Context& context, const std::string& address);
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
  // Completed handshakes so far. If the number has grown, requests held by an earlier peer are
  // lost.
  uint32_t connections();
  void* handle() const { return socket_; }
  // A socket that is readable when connections() may have grown; only to be waited for.
  void* monitor_handle() const { return monitor_; }

 private:
  DealerSocket(Context context, void* socket, void* monitor)
      : context_(std::move(context)), socket_(socket), monitor_(monitor) {}
  Context context_;
  void* socket_ = nullptr;
  void* monitor_ = nullptr;
  uint32_t connections_ = 0;
  int receive_timeout_ms_ = -1;
};

// Waits until one of the sockets or descriptors is readable, at most `timeout_ms`; returns whether
// one is.
bool WaitAnyReadable(std::span<void* const> sockets, int64_t timeout_ms,
                     std::span<const int> fds = {});

// The parts of an address "tcp://host:port", made by ParseTcpAddress; kInvalidArgument for others.
struct TcpAddress {
  std::string host;
  uint16_t port = 0;
};
Result<TcpAddress> ParseTcpAddress(std::string_view address);
// The path of an address "ipc:///path", which must fit sockaddr_un.
Result<std::string> ParseIpcAddress(std::string_view address);

}  // namespace b4mrl
