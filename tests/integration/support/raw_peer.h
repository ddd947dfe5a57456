// A connection on which a test says whatever it likes: many sessions at once, nothing waited for.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"

namespace b4mrl {

class RawPeer {
 public:
  RawPeer(Context& context, const std::string& address);

  // Fills in version, id and `token`; waits while too much is unanswered. The request's id.
  uint64_t Send(pb::Request request, const std::string& token);
  // Takes the replies that are there.
  void Pump();
  // Waits until everything sent is answered; false if that takes more than `patience_ms`.
  bool AwaitAll(int64_t patience_ms);
  // Send, and the reply to it.
  pb::Reply Call(pb::Request request, const std::string& token, int64_t patience_ms);

  // The reply that came last.
  const pb::Reply& last() const { return last_; }
  // By status code.
  const std::map<StatusCode, uint64_t>& answers() const { return answers_; }

 private:
  DealerSocket socket_;
  uint64_t sent_ = 0;
  uint64_t answered_ = 0;
  std::map<StatusCode, uint64_t> answers_;
  pb::Reply last_;
};

// "ipc://..." or "tcp://127.0.0.1:..." of a port in a reply.
std::string AddressOf(const pb::Port& port);

}  // namespace b4mrl
