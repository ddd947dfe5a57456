// Places where a test may break the process. In production the hook is null and a point costs one
// load of a pointer. tests/integration builds a server that sets it from an environment variable.
#pragma once

#include <cstdint>
#include <span>

namespace b4mrl {

enum class FaultPoint : uint8_t {
  kBeforeAttach,     // nothing was built of the session; `lane` is its number of lanes
  kBeforeOperation,  // the lane is marked as running; nothing was computed
  kSlotHalfWritten,  // the idle buffer holds the new record without its seal
  kAfterCommit,      // committed, not answered
  kBeforeQueryRow,   // `lane` is the row of the request
};

// `idle_buffer` is the buffer being written, empty where there is none. May never return.
using FaultHook = void (*)(FaultPoint point, uint32_t lane, uint64_t number,
                           std::span<std::byte> idle_buffer);

// Set before threads start and never again.
inline FaultHook fault_hook = nullptr;

inline void ReachFaultPoint(FaultPoint point, uint32_t lane, uint64_t number,
                            std::span<std::byte> idle_buffer = {}) {
  if (fault_hook != nullptr) fault_hook(point, lane, number, idle_buffer);
}

}  // namespace b4mrl
