#include "server/datasets/parked_requests.h"

#include <algorithm>
#include <utility>

namespace b4mrl {

bool ParkedRequests::AbsorbsCopy(PendingRequest* copy) {
  for (auto& [id, parked] : parked_) {
    if (!IsCopy(&parked, copy)) continue;
    parked.deadline = copy->deadline;  // the time that its sender gives it by now
    return true;
  }
  return false;
}

uint64_t ParkedRequests::Add(PendingRequest pending) {
  parked_.emplace(next_id_, ParkedRequest{std::move(pending)});
  return next_id_++;
}

ParkedRequest* ParkedRequests::Find(uint64_t id) {
  const auto found = parked_.find(id);
  return found == parked_.end() ? nullptr : &found->second;
}

std::optional<ParkedRequest> ParkedRequests::Take(uint64_t id) {
  auto node = parked_.extract(id);
  if (node.empty()) return std::nullopt;
  return std::move(node.mapped());
}

std::vector<ParkedRequest> ParkedRequests::TakeExpired() {
  std::vector<ParkedRequest> expired;
  for (auto it = parked_.begin(); it != parked_.end();) {
    if (!it->second.deadline.expired()) {
      ++it;
      continue;
    }
    expired.push_back(std::move(it->second));
    it = parked_.erase(it);
  }
  return expired;
}

std::vector<ParkedRequest> ParkedRequests::TakeAll() {
  std::vector<ParkedRequest> all;
  for (auto& [id, parked] : std::exchange(parked_, {})) all.push_back(std::move(parked));
  return all;
}

size_t ParkedRequests::SizeOf(const RoutingId& peer) const {
  return std::ranges::count_if(parked_,
                               [&](const auto& entry) { return entry.second.from.peer == peer; });
}

}  // namespace b4mrl
