// Plays cases of the conformance table (README.md) against a server: sends what a case says, byte
// for byte, and compares the replies with what it expects.
//
// Speaks through the client side's sockets and frames, but not through its Connection, which would
// not send a wrong request. Errors are a Status that says what was expected and what came. Thread
// rule: one thread.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/status.h"
#include "proto/wire/socket.h"
#include "tests/conformance/case_message.h"
#include "tests/conformance/peer.h"

namespace b4mrl::conformance {

class CaseRunner {
 public:
  // `use_doors`: messages to workers go through local doors as far as a door can carry them.
  CaseRunner(std::string endpoint, bool use_doors)
      : endpoint_(std::move(endpoint)), use_doors_(use_doors) {}

  // Says Hello; kUnavailable if nobody answers.
  Status Connect();
  // OK if the server passed. `json` is one element of the table.
  Status Run(const nlohmann::json& json);

 private:
  struct Awaited {
    uint64_t id = 0;
    size_t step = 0;
    bool arrived = false;
    ReplyMessage reply;
  };

  Status RunSteps(const nlohmann::json& steps);
  Status SendStep(const nlohmann::json& step, size_t index);
  // `may_be_door`: whether a door can carry what the step sends.
  Result<Peer*> PeerFor(const nlohmann::json& step, bool may_be_door);
  Result<Peer*> PeerAt(const std::string& address, const std::string& door);
  // Of a process that listens on `port`; the gateway's own where it does not.
  std::string AddressOf(const pb::Port& port) const;
  std::string TokenFor(const nlohmann::json& step);
  // Waits for all replies that are due.
  Status Receive();
  void Accept(Message message);
  Status CheckReplies(const nlohmann::json& steps);
  void CloseSessions();

  Context context_;
  std::string endpoint_;
  bool use_doors_;
  std::string dataset_address_;
  std::map<std::string, std::unique_ptr<Peer>> peers_;  // by address, or a door's name
  std::map<std::string, std::string> tokens_;           // by a session's name
  std::map<std::string, pb::Port> workers_;             // of sessions, likewise
  std::optional<pb::Port> last_worker_;                 // of the case's last Open
  std::map<std::string, ReplyMessage> labels_;
  std::vector<Awaited> awaited_;
  uint64_t next_id_ = 1'000;  // below it are those that the table names
};

}  // namespace b4mrl::conformance
