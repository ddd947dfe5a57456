// A client's end of a local door (proto/wire/door.h), with the methods of a DealerSocket.
//
// When the worker dies, the door connects again: the supervisor holds the listening socket, so the
// replacement finds the connection waiting. The memory is new then, and what the old worker had not
// answered is lost, as connections() tells. A door that refuses a client several times in a row, or
// that has gone, is_refused(), and the caller goes on over ZeroMQ.
//
// Thread rule: one thread.
#pragma once

#include <atomic>
#include <optional>
#include <string>

#include "proto/base/clock.h"
#include "proto/base/spin.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/door.h"
#include "proto/wire/frame.h"
#include "proto/wire/ring.h"

namespace b4mrl {

class ClientDoor {
 public:
  // Connects to the door `name` and waits for its greeting. kUnavailable when nobody listens there,
  // when the worker refuses this process, when no greeting came before the deadline, or 20 ms after
  // `cancelled`, if given, turned true.
  static Result<ClientDoor> Connect(const std::string& name, const Deadline& deadline,
                                    const std::atomic<bool>* cancelled = nullptr);

  // Waits 20 ms at most for the worker to make space in the ring, which a long message fills by
  // itself; what is left is sent by later calls of Send and Receive. kUnavailable when too many
  // messages wait. A message that is sent while the worker is being replaced is lost, as
  // connections() tells.
  Status Send(Message message);
  // Waits for the next message until the deadline, but at most 20 ms, after which the caller may
  // look at connections().
  std::optional<Message> Receive(const Deadline& deadline);
  // Greetings so far. If the number has grown, requests held by an earlier worker are lost.
  uint32_t connections() const { return connections_; }
  bool is_refused() const { return refusals_ >= kMostRefusals; }

 private:
  static constexpr int kMostRefusals = 3;
  // What exists while the door is open. Constructed from the worker's greeting.
  struct Open {
    explicit Open(DoorMemory mapped)
        : memory(std::move(mapped)), writer(memory.up()), reader(memory.down()) {}
    DoorMemory memory;
    RingWriter writer;
    RingReader reader;
  };

  explicit ClientDoor(std::string name) : name_(std::move(name)), spinner_({}) {}
  // Connects, or goes on connecting: reads the greeting, for which it waits until the deadline.
  void Connect(const Deadline& deadline);
  Status ReadGreeting();
  // Ends the connection, so that the next call of Receive makes a new one.
  void Close();
  // Publishes what waits; closes a door whose ring is broken.
  void Write();
  std::optional<Message> Take();
  // Waits for the next message, first awake, then asleep.
  std::optional<Message> Await(const Deadline& longest);
  // Sleeps until the peer rings for one of the reasons, or until the deadline; 20 ms at most.
  void Sleep(uint32_t reasons, const Deadline& deadline);

  std::string name_;
  UniqueFd socket_;
  std::optional<Open> open_;
  uint32_t connections_ = 0;
  int refusals_ = 0;  // since the last greeting
  Spinner spinner_;
};

}  // namespace b4mrl
