#include "server/door/door.h"

#include <sys/socket.h>

#include <cerrno>
#include <memory>
#include <utility>

#include "proto/base/limits.h"
#include "proto/wire/descriptors.h"

namespace b4mrl {
namespace {

// Bells that are read before the other doors have their turn.
constexpr int kBellBurst = 64;

}  // namespace

Result<std::unique_ptr<Door>> Door::Greet(UniqueFd socket, uint64_t number, uint32_t spin_us) {
  DoorGreeting greeting;
  greeting.up_bytes = greeting.down_bytes = limits::kRingBytes;
  greeting.spin_us = spin_us;
  B4MRL_ASSIGN_OR_RETURN(DoorMemory memory,
                         DoorMemory::Create(greeting.up_bytes, greeting.down_bytes));
  const int memory_fd = memory.fd();
  if (!SendWithDescriptors(socket.get(), &greeting, sizeof(greeting), {&memory_fd, 1})) {
    return IoError("greet", "the client of a door", errno);
  }
  memory.CloseFd();
  return std::unique_ptr<Door>(new Door(std::move(socket), std::move(memory), number));
}

void Door::Drop() {
  is_dropped_ = true;
  socket_.Reset();
}

std::optional<Message> Door::Receive() {
  if (is_dropped_) return std::nullopt;
  Message message;
  bool is_whole = false;
  const RingResult result = reader_.Take(&message, &is_whole);
  if (result == RingResult::kBroken) Drop();
  if (result == RingResult::kMoved) {
    idle_bells_ = 0;
    if (!is_whole) last_bytes_ = Clock::now();
    if (is_open()) WakePeer(socket_.get(), &words().client_sleeps, kSleepsForSpace);
    // Each look takes a line at least. Whoever is not done by now has kept the memory after closing
    // the socket, and writes on and on.
    if (!is_open() && --last_looks_ == 0) Drop();
  }
  if (!is_whole) return std::nullopt;
  return message;
}

void Door::Send(Message message) {
  writer_.Push(std::move(message));
  Write();
}

void Door::Write() {
  if (!is_open()) return;
  const RingResult result = writer_.Write();
  if (result == RingResult::kBroken) Drop();
  if (result != RingResult::kMoved) return;
  idle_bells_ = 0;
  WakePeer(socket_.get(), &words().client_sleeps, kSleepsForBytes);
}

void Door::BeginSleep() {
  words().worker_sleeps.store(kSleepsForBytes | (writer_.queued() > 0 ? kSleepsForSpace : 0),
                              std::memory_order_relaxed);
}

void Door::EndSleep() { words().worker_sleeps.store(0, std::memory_order_relaxed); }

void Door::ReadBells() {
  char bell = 0;
  for (int i = 0; i < kBellBurst; ++i) {
    const ssize_t received = recv(socket_.get(), &bell, sizeof(bell), MSG_DONTWAIT);
    if (received < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (received <= 0) return socket_.Reset();
    if (++idle_bells_ > limits::kMaxDoorBells) return Drop();
  }
}

}  // namespace b4mrl
