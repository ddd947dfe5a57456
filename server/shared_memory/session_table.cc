#include "server/shared_memory/session_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

bool HoldsLanes(const SessionRecord& record) { return record.state() != SessionState::kFree; }

bool IsOpen(const SessionRecord& record) {
  const SessionState state = record.state();
  return state == SessionState::kOpening || state == SessionState::kLive;
}

}  // namespace

std::optional<uint32_t> SessionTable::Find(std::string_view token) const {
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    if (Holds(index, token)) return index;
  }
  return std::nullopt;
}

bool SessionTable::Holds(uint32_t index, std::string_view token) const {
  if (index >= limits::kMaxSessions) return false;
  const SessionRecord& record = shared_.session(index);
  return IsOpen(record) && SessionToken(record) == token;
}

Result<uint32_t> SessionTable::Allocate(const NewSession& session) {
  if (session.open_bytes.size() > limits::kMaxOpenRecordBytes) {
    return InvalidNumber("bytes of the complete Open request",
                         static_cast<double>(session.open_bytes.size()),
                         fmt::format("at most {}", limits::kMaxOpenRecordBytes));
  }
  Reap(INT64_MAX);
  std::optional<uint32_t> free_index;
  for (uint32_t i = 0; i < limits::kMaxSessions && !free_index; ++i) {
    if (!HoldsLanes(shared_.session(i))) free_index = i;
  }
  if (!free_index) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} sessions are open, at most {}", limits::kMaxSessions,
                              limits::kMaxSessions));
  }
  const std::optional<uint32_t> first_lane = FindLanes(session.lanes);
  if (!first_lane) {
    return Status(StatusCode::kLimitExceeded, fmt::format("no {} lanes in a row are free of {}",
                                                          session.lanes, limits::kMaxLanes));
  }
  SessionRecord& record = shared_.session(*free_index);
  record.worker.store(LeastLoadedWorker());
  record.first_lane.store(*first_lane);
  record.lane_count.store(session.lanes);
  record.generation.store(shared_.header().next_generation.fetch_add(1));
  record.last_activity_ms.store(MonotonicMs());
  record.steps.store(0);
  record.build_deaths.store(0);
  record.simulator_hash.store(0);
  for (RequestBlame& entry : record.request_blames) entry.blame.store(0);
  std::memcpy(record.token.data(), session.token.data(), record.token.size());
  record.request_hash = session.request_hash;
  record.open_size = static_cast<uint32_t>(session.open_bytes.size());
  std::memcpy(record.open.data(), session.open_bytes.data(), session.open_bytes.size());
  record.checksum = SessionChecksum(record);
  record.granted.store(SessionState::kOpening, std::memory_order_release);
  return *free_index;
}

bool SessionTable::MakeLive(uint32_t index) {
  SessionRecord& record = shared_.session(index);
  if (!IsOpen(record)) return false;
  record.granted.store(SessionState::kLive, std::memory_order_release);
  return record.state() == SessionState::kLive;
}

void SessionTable::Free(uint32_t index) {
  shared_.session(index).granted.store(SessionState::kFree, std::memory_order_release);
}

void SessionTable::Reap(int64_t abandoned_ms) {
  const int64_t now = MonotonicMs();
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = shared_.session(index);
    const SessionState state = record.state();
    const bool abandoned =
        state == SessionState::kOpening && now - record.last_activity_ms.load() > abandoned_ms;
    if (state == SessionState::kClosed || abandoned) Free(index);
  }
}

uint32_t SessionTable::LeastLoadedWorker() const {
  struct Load {
    bool is_down = false;  // it has no sessions while it dies again and again, and would get all
    uint32_t lanes = 0;
    uint32_t sessions = 0;
    auto operator<=>(const Load&) const = default;
  };
  std::vector<Load> load(shared_.worker_count());
  for (uint32_t worker = 0; worker < load.size(); ++worker) {
    load[worker].is_down = shared_.worker_is_down(worker);
  }
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = shared_.session(index);
    if (!IsOpen(record) || record.worker >= load.size()) continue;
    // A session without lanes, which only queries, is work as well.
    load[record.worker].lanes += std::max(record.lane_count.load(), 1u);
    load[record.worker].sessions += 1;
  }
  return static_cast<uint32_t>(std::min_element(load.begin(), load.end()) - load.begin());
}

std::optional<uint32_t> SessionTable::FindLanes(uint32_t count) const {
  std::vector<std::pair<uint32_t, uint32_t>> used;  // lanes [first, end) of each record
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = shared_.session(index);
    if (!HoldsLanes(record) || record.lane_count == 0) continue;
    used.emplace_back(record.first_lane, record.first_lane + record.lane_count);
  }
  std::sort(used.begin(), used.end());
  uint32_t free_from = 0;
  for (const auto& [first, end] : used) {
    if (first >= free_from && first - free_from >= count) return free_from;
    free_from = std::max(free_from, end);
  }
  if (free_from > limits::kMaxLanes || limits::kMaxLanes - free_from < count) return std::nullopt;
  return free_from;
}

}  // namespace b4mrl
