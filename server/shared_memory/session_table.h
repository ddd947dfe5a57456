// The session records as a table: which sessions exist, which lanes are free, which worker has the
// fewest. All of its state lies in shared memory, so a replaced gateway goes on where the dead
// gateway was. Thread rule: the gateway's main thread; const members, any thread.
#pragma once

#include <optional>
#include <string_view>

#include "proto/base/status.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

class SessionTable {
 public:
  explicit SessionTable(SharedState& shared) : shared_(shared) {}

  // The index of the record of the session with this token, if it is opening or live.
  std::optional<uint32_t> Find(std::string_view token) const;
  // Whether Find(token) would return `index`; one comparison instead of a search. Any index.
  bool Holds(uint32_t index, std::string_view token) const;

  struct NewSession {
    std::string_view token;       // limits::kTokenBytes long
    std::string_view open_bytes;  // serialised, complete; at most limits::kMaxOpenRecordBytes
    uint64_t request_hash = 0;
    uint32_t lanes = 0;
  };
  // Writes a kOpening record for the worker with the fewest lanes (then sessions) of those that
  // run, if any does; a session without lanes counts as one lane. kLimitExceeded when no record or
  // no run of free lanes is left; kInvalidArgument for more open_bytes.
  Result<uint32_t> Allocate(const NewSession& session);
  // Makes a kOpening record kLive, as its worker has acknowledged it. False if the worker has
  // closed the session meanwhile.
  bool MakeLive(uint32_t index);
  // Makes record `index` kFree. No worker may hold it.
  void Free(uint32_t index);
  // Frees the sessions that workers have closed, and those whose Open no client has repeated for
  // `abandoned_ms` while they were opening.
  void Reap(int64_t abandoned_ms);

 private:
  uint32_t LeastLoadedWorker() const;
  // The first run of `count` lanes that no record uses.
  std::optional<uint32_t> FindLanes(uint32_t count) const;

  SharedState& shared_;
};

}  // namespace b4mrl
