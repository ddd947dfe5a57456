// Work for a queue that nobody executes.
#pragma once

#include <optional>

#include "server/scheduling/work_queue.h"

namespace b4mrl {

// What an item costs for good, in microseconds. A piece is half a millisecond, a bite a tenth.
struct Cost : ItemCost {
  explicit Cost(double us) { Observe(us); }
};

inline QueuedWork Work(uint32_t session, WorkKind kind, uint32_t items, ItemCost& cost) {
  QueuedWork work;
  work.session = session;
  work.work_kind = kind;
  work.items = items;
  work.cost = &cost;
  work.deadline = Deadline::AfterMs(1'000'000);
  return work;
}

inline std::optional<Piece> Take(WorkQueue& queue) {
  Spinner spinner({});
  return queue.Take(spinner);
}

}  // namespace b4mrl
