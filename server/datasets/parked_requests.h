// The requests that wait until a dataset is listed, opened, prepared or mapped, each under an id.
// Thread rule: one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "proto/wire/socket.h"
#include "server/replies/pending_request.h"

namespace b4mrl {

struct ParkedRequest : PendingRequest {
  bool file_was_imported = false;  // of an OpenDataset: its one import has been asked for
};

class ParkedRequests {
 public:
  // Whether the request is a copy of one that is parked, which then gets the copy's deadline.
  bool AbsorbsCopy(PendingRequest* copy);
  // Returns the request's id, at least 1.
  uint64_t Add(PendingRequest pending);
  // Null once the request was taken out.
  ParkedRequest* Find(uint64_t id);
  std::optional<ParkedRequest> Take(uint64_t id);
  // Takes out the requests whose deadline has passed, or all.
  std::vector<ParkedRequest> TakeExpired();
  std::vector<ParkedRequest> TakeAll();

  size_t size() const { return parked_.size(); }
  size_t SizeOf(const RoutingId& peer) const;

 private:
  std::map<uint64_t, ParkedRequest> parked_;
  uint64_t next_id_ = 1;
};

}  // namespace b4mrl
