#include "server/door/doors.h"

#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr int kAcceptBurst = 16;
constexpr int kEventBurst = 64;
constexpr int64_t kDrainLookMs = 10;

RoutingId SenderOf(uint64_t number) {
  return {reinterpret_cast<const char*>(&number), sizeof(number)};
}

uint64_t NumberOf(const RoutingId& sender) {
  uint64_t number = 0;
  std::memcpy(&number, sender.data(), std::min(sender.size(), sizeof(number)));
  return number;
}

}  // namespace

Doors::Doors(int listener, uint32_t spin_us, UnreadBytes unread, size_t unfinished_bytes)
    : listener_(listener),
      spin_us_(spin_us),
      most_unfinished_bytes_(unfinished_bytes),
      unread_(std::move(unread)) {
  if (listener_ < 0) return;
  epoll_ = UniqueFd(epoll_create1(EPOLL_CLOEXEC));
  epoll_event event{EPOLLIN, {.u64 = 0}};
  epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, listener_, &event);
}

void Doors::Attend() {
  if (!epoll_.valid()) return;
  epoll_event events[kEventBurst];
  const int count = epoll_wait(epoll_.get(), events, kEventBurst, 0);
  for (int i = 0; i < count; ++i) {
    if (events[i].data.u64 == 0) {
      Accept();
    } else if (Door* door = Find(events[i].data.u64); door != nullptr) {
      door->ReadBells();
    }
  }
  std::erase_if(doors_, [](const std::unique_ptr<Door>& door) { return door->is_over(); });
}

void Doors::Accept() {
  for (int i = 0; i < kAcceptBurst; ++i) {
    UniqueFd socket(accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!socket.valid()) return;
    // Whoever is refused here finds the connection closed, and uses ZeroMQ.
    if (doors_.size() < limits::kMaxDoors && PeerIsTrusted(socket.get())) Greet(std::move(socket));
  }
}

void Doors::Greet(UniqueFd socket) {
  const int fd = socket.get();
  Result<std::unique_ptr<Door>> door = Door::Greet(std::move(socket), last_number_ + 1, spin_us_);
  if (!door.ok()) return;
  epoll_event event{EPOLLIN, {.u64 = ++last_number_}};
  if (epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event) != 0) return;
  doors_.push_back(*std::move(door));
}

Door* Doors::Find(uint64_t number) const {
  const auto found = std::lower_bound(
      doors_.begin(), doors_.end(), number,
      [](const std::unique_ptr<Door>& door, uint64_t wanted) { return door->number() < wanted; });
  return found != doors_.end() && (*found)->number() == number ? found->get() : nullptr;
}

bool Doors::HasTooManyUnfinished() const {
  size_t bytes = 0, messages = 0;
  for (const auto& door : doors_) {
    bytes += door->unfinished_bytes();
    if (door->unfinished_bytes() > 0) ++messages;
  }
  return messages > 1 && bytes > most_unfinished_bytes_;
}

void Doors::BoundUnfinished() {
  // The door that has stood still for longest comes first, doors without such a message last.
  const auto is_earlier = [](const std::unique_ptr<Door>& a, const std::unique_ptr<Door>& b) {
    return std::pair(a->unfinished_bytes() == 0, a->last_bytes()) <
           std::pair(b->unfinished_bytes() == 0, b->last_bytes());
  };
  while (HasTooManyUnfinished()) {
    (*std::min_element(doors_.begin(), doors_.end(), is_earlier))->Drop();
  }
}

std::optional<IncomingMessage> Doors::TryReceive() {
  for (size_t i = 0; i < doors_.size(); ++i) {
    Door& door = *doors_[next_++ % doors_.size()];
    if (!door.HasWork()) continue;
    door.Write();
    std::optional<Message> message = door.Receive();
    if (message) return IncomingMessage{SenderOf(door.number()), std::move(*message)};
    if (door.unfinished_bytes() == 0) continue;
    BoundUnfinished();
    return std::nullopt;
  }
  return std::nullopt;
}

Status Doors::Send(const RoutingId& receiver, Message message) {
  Door* const door = Find(NumberOf(receiver));
  if (door == nullptr || !door->is_open()) {
    return Status(StatusCode::kUnavailable, "the peer has gone");
  }
  if (door->queued() >= static_cast<size_t>(limits::kHighWaterMark)) {
    return Status(StatusCode::kLimitExceeded, "the peer does not read its replies");
  }
  B4MRL_RETURN_IF_ERROR(unread_.Count(receiver, &message));
  door->Send(std::move(message));
  return Status();
}

void Doors::Write() {
  for (const auto& door : doors_) {
    if (door->queued() > 0) door->Write();
  }
}

bool Doors::HasWork() const {
  return std::any_of(doors_.begin(), doors_.end(),
                     [](const std::unique_ptr<Door>& door) { return door->HasWork(); });
}

bool Doors::BeginSleep() {
  for (const auto& door : doors_) door->BeginSleep();
  std::atomic_thread_fence(std::memory_order_seq_cst);  // AnnounceSleep's, once for all doors
  return !HasWork();
}

void Doors::EndSleep() {
  for (const auto& door : doors_) door->EndSleep();
}

bool Doors::AnyQueued() const {
  return std::any_of(doors_.begin(), doors_.end(),
                     [](const std::unique_ptr<Door>& door) { return door->queued() > 0; });
}

void Doors::Drain(int64_t longest_ms) {
  const Deadline end = Deadline::AfterMs(longest_ms);
  while (AnyQueued() && !end.expired()) {
    epoll_event event;
    if (BeginSleep()) epoll_wait(epoll_.get(), &event, 1, kDrainLookMs);
    EndSleep();
    Attend();
    Write();
  }
}

}  // namespace b4mrl
