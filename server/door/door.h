// A worker's end of one local door (proto/wire/door.h): the connection of one client.
//
// Thread rule: the worker's socket thread.
#pragma once

#include <cstdint>
#include <optional>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"
#include "proto/wire/frame.h"
#include "proto/wire/ring.h"

namespace b4mrl {

class Door {
 public:
  // Makes the memory of a connection that was accepted and sends the greeting with it. kIoError
  // when the system gives no memory or the client has gone.
  static Result<std::unique_ptr<Door>> Greet(UniqueFd socket, uint64_t number, uint32_t spin_us);

  // Never repeats in this process.
  uint64_t number() const { return number_; }
  int socket() const { return socket_.get(); }
  // Whether the client has gone, or has broken the rules of the ring. Such a door does nothing.
  bool is_dead() const { return is_dead_; }

  // Whether Receive or Write would find something to do.
  bool HasWork() const {
    return !is_dead_ && (reader_.HasBytes() || (writer_.queued() > 0 && writer_.HasSpace()));
  }
  // Takes what the ring holds of the next message, and returns the message once it is whole. A
  // client that announces a payload of more than `largest_payload` bytes is dropped.
  std::optional<Message> Receive(size_t largest_payload);
  // Memory of a message that has not come entirely, in bytes.
  size_t unfinished_bytes() const { return reader_.unfinished_bytes(); }

  // Messages that are not wholly in the ring.
  size_t queued() const { return is_dead_ ? 0 : writer_.queued(); }
  // Queues a message and publishes what there is space for.
  void Send(Message message);
  // Publishes what there is space for by now.
  void Write();

  // Says that the worker is about to sleep; EndSleep follows.
  void BeginSleep();
  void EndSleep();
  // Takes the client's bells off the socket, which is readable, and notices the client's end.
  void ReadBells();

 private:
  Door(UniqueFd socket, DoorMemory memory, uint64_t number)
      : socket_(std::move(socket)),
        memory_(std::move(memory)),
        reader_(memory_.up()),
        writer_(memory_.down()),
        number_(number) {}
  DoorWords& words() { return memory_.words(); }

  UniqueFd socket_;
  DoorMemory memory_;
  RingReader reader_;
  RingWriter writer_;
  uint64_t number_;
  uint32_t idle_bells_ = 0;  // since the last byte in the ring
  bool is_dead_ = false;
};

}  // namespace b4mrl
