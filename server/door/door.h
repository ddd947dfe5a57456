// A worker's end of one local door (proto/wire/door.h): the connection of one client.
//
// Thread rule: the worker's socket thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/limits.h"
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
  // Whether the client is there. What it has sent before its end can still be received.
  bool is_open() const { return socket_.valid(); }
  // Whether nothing more is to come from the client: it has gone, and everything that it sent was
  // received, or it was dropped. Such a door does nothing.
  bool is_over() const { return is_dropped_ || (!is_open() && !reader_.HasBytes()); }
  // Ends the connection with a client that has broken the rules, or takes more than its share.
  void Drop();

  // Whether Receive or Write would find something to do.
  bool HasWork() const {
    return !is_dropped_ && (reader_.HasBytes() || (queued() > 0 && writer_.HasSpace()));
  }
  // Takes what the ring holds of the next message, and returns the message once it is whole.
  std::optional<Message> Receive();
  // Memory that a message which has not come entirely may take, in bytes.
  size_t unfinished_bytes() const { return is_over() ? 0 : reader_.unfinished_bytes(); }
  // When bytes of a message that had not come entirely were last taken from the ring.
  Clock::time_point last_bytes() const { return last_bytes_; }

  // Messages that are not wholly in the ring.
  size_t queued() const { return is_open() ? writer_.queued() : 0; }
  // Queues a message and publishes what there is space for.
  void Send(Message message);
  // Publishes what there is space for by now.
  void Write();

  // Says that the worker is about to sleep; EndSleep follows.
  void BeginSleep();
  void EndSleep();
  // Takes the client's bells off the socket, which is readable, and notices the client's end; then
  // the socket is closed.
  void ReadBells();

 private:
  Door(UniqueFd socket, DoorMemory memory, uint64_t number)
      : socket_(std::move(socket)),
        memory_(std::move(memory)),
        reader_(memory_.up()),
        writer_(memory_.down()),
        number_(number) {}
  DoorWords& words() { return memory_.words(); }

  UniqueFd socket_;  // invalid once the client has ended
  DoorMemory memory_;
  RingReader reader_;
  RingWriter writer_;
  uint64_t number_;
  uint32_t idle_bells_ = 0;  // since bytes last went through either ring
  // How often the ring is still read once the client has ended.
  uint32_t last_looks_ = limits::kRingBytes / kRingLine;
  Clock::time_point last_bytes_{};
  bool is_dropped_ = false;
};

}  // namespace b4mrl
