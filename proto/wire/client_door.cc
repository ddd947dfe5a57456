#include "proto/wire/client_door.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "proto/base/limits.h"
#include "proto/wire/descriptors.h"

namespace b4mrl {
namespace {

// The longest sleep. A bell that is lost then costs this time and no more.
constexpr int64_t kLongestSleepMs = 20;

Deadline Earlier(const Deadline& deadline, int64_t milliseconds) {
  const Deadline other = Deadline::AfterMs(milliseconds);
  return deadline.at() < other.at() ? deadline : other;
}

// Receives a greeting and the descriptor that comes with it.
Result<DoorMemory> ReceiveMemory(int socket, uint32_t* spin_us) {
  DoorGreeting greeting;
  UniqueFd fd = ReceiveWithDescriptor(socket, &greeting, sizeof(greeting), MSG_DONTWAIT);
  if (!fd.valid()) {
    return Status(StatusCode::kUnavailable,
                  "the door was closed before its greeting, or it sent something else");
  }
  *spin_us = std::min(greeting.spin_us, limits::kMaxSpinUs);
  return DoorMemory::Map(std::move(fd), greeting);
}

}  // namespace

Result<ClientDoor> ClientDoor::Connect(const std::string& name, const Deadline& deadline,
                                       const std::atomic<bool>* cancelled) {
  ClientDoor door(name);
  while (!door.open_ && !door.is_refused() && !deadline.expired()) {
    if (cancelled != nullptr && *cancelled) break;
    door.Connect(Earlier(deadline, kLongestSleepMs));
  }
  if (door.open_) return door;
  return Status(StatusCode::kUnavailable, fmt::format("the door {} does not open", name));
}

void ClientDoor::Connect(const Deadline& deadline) {
  if (!socket_.valid()) {
    socket_ = UniqueFd(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    sockaddr_un address;
    const socklen_t length = DoorAddress(name_, &address);
    if (connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), length) != 0) {
      // A full backlog passes; where nobody listens, nobody will.
      refusals_ += errno == EAGAIN ? 1 : kMostRefusals;
      return Close();
    }
    if (!PeerIsTrusted(socket_.get())) {
      refusals_ += kMostRefusals;
      return Close();
    }
  }
  pollfd waited{socket_.get(), POLLIN, 0};
  if (poll(&waited, 1, static_cast<int>(deadline.remaining_ms())) <= 0) return;
  if (ReadGreeting().ok()) return;
  ++refusals_;
  Close();
}

Status ClientDoor::ReadGreeting() {
  uint32_t spin_us = 0;
  B4MRL_ASSIGN_OR_RETURN(DoorMemory memory, ReceiveMemory(socket_.get(), &spin_us));
  open_.emplace(std::move(memory));
  spinner_ = Spinner(SpinBudget(spin_us));
  ++connections_;
  refusals_ = 0;
  return Status();
}

void ClientDoor::Close() {
  open_.reset();
  socket_.Reset();
}

Status ClientDoor::Send(Message message) {
  if (!open_) return Status();
  if (open_->writer.queued() >= static_cast<size_t>(limits::kHighWaterMark)) {
    return Status(StatusCode::kUnavailable, "the queue towards the server is full");
  }
  open_->writer.Push(std::move(message));
  Write();
  if (!open_ || open_->writer.queued() == 0) return Status();
  const Deadline longest = Deadline::AfterMs(kLongestSleepMs);
  while (open_ && open_->writer.queued() > 0 && !longest.expired()) {
    Sleep(kSleepsForSpace, longest);
    Write();
  }
  return Status();
}

std::optional<Message> ClientDoor::Receive(const Deadline& deadline) {
  std::optional<Message> message = Take();
  if (!message && open_) message = Await(Earlier(deadline, kLongestSleepMs));
  // At once, even after the deadline: the caller may have been away while the worker was replaced,
  // and should learn that before it gives up its requests.
  if (!open_) Connect(Deadline::AfterMs(kLongestSleepMs));
  return message;
}

std::optional<Message> ClientDoor::Await(const Deadline& longest) {
  const Clock::time_point since = Clock::now();
  std::optional<Message> message;
  while (open_ && !message) {
    Write();
    if (!open_) break;
    const bool writes = open_->writer.queued() > 0;
    const auto has_bytes = [this] { return open_->reader.HasBytes(); };
    if (writes || !spinner_.Spin(since, has_bytes)) {
      Sleep(kSleepsForBytes | (writes ? kSleepsForSpace : 0), longest);
    }
    message = Take();
    if (longest.expired()) break;
  }
  if (message) spinner_.Learn(Clock::now() - since);
  return message;
}

void ClientDoor::Write() {
  if (!open_) return;
  const RingResult result = open_->writer.Write();
  if (result == RingResult::kBroken) return Close();
  if (result == RingResult::kMoved) {
    WakePeer(socket_.get(), &open_->memory.words().worker_sleeps, kSleepsForBytes);
  }
}

std::optional<Message> ClientDoor::Take() {
  Message message;
  bool is_whole = false;
  RingResult result = RingResult::kMoved;
  while (open_ && !is_whole && result == RingResult::kMoved) {
    result = open_->reader.Take(&message, &is_whole);
    if (result == RingResult::kBroken) Close();
    if (result == RingResult::kMoved) {
      WakePeer(socket_.get(), &open_->memory.words().worker_sleeps, kSleepsForSpace);
    }
  }
  if (!is_whole) return std::nullopt;
  return message;
}

void ClientDoor::Sleep(uint32_t reasons, const Deadline& deadline) {
  std::atomic<uint32_t>& sleeps = open_->memory.words().client_sleeps;
  AnnounceSleep(&sleeps, reasons);
  const bool is_over = ((reasons & kSleepsForBytes) != 0 && open_->reader.HasBytes()) ||
                       ((reasons & kSleepsForSpace) != 0 && open_->writer.HasSpace());
  pollfd waited{socket_.get(), POLLIN, 0};
  const int timeout_ms = is_over ? 0 : static_cast<int>(deadline.remaining_ms());
  const bool is_ringing = !is_over && poll(&waited, 1, timeout_ms) > 0;
  sleeps.store(0, std::memory_order_relaxed);
  if (!is_ringing) return;
  char bell = 0;
  const ssize_t received = recv(socket_.get(), &bell, sizeof(bell), MSG_DONTWAIT);
  const bool has_gone = received == 0 || (received < 0 && errno != EAGAIN && errno != EINTR);
  // What a dying worker has published is still in the memory and is taken first.
  if (has_gone && !open_->reader.HasBytes()) Close();
}

}  // namespace b4mrl
