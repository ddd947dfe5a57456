// Places where a test may break the worker's process. In production the hook is null, and a fault
// point costs one load of a pointer. tests/integration builds a server that sets the hook from an
// environment variable.
#pragma once

#include <cstdint>
#include <span>

namespace b4mrl {

enum class FaultPoint : uint8_t {
  kBeforeAttach,     // before a session is built; `lane` is its number of lanes
  kBeforeOperation,  // the lane is marked, and nothing of its operation was computed
  kSlotHalfWritten,  // the lane's idle buffer holds the new record without its seal
  kAfterCommit,      // the lane's operation is committed, and not answered
  kBeforeQueryRow,   // before a query's row; `lane` is the row's number in the request
  kBeforeSnapshot,   // before a lane's state is read for a snapshot
  kBeforeRestore,    // the lane is marked, and its state is still to be set by its parts
};

// `idle_buffer` is the buffer that is being written, or empty. The hook need not return.
using FaultHook = void (*)(FaultPoint point, uint32_t lane, uint64_t number,
                           std::span<std::byte> idle_buffer);

// A process sets it before its threads start, and a test while no other thread executes work.
inline FaultHook fault_hook = nullptr;

inline void ReachFaultPoint(FaultPoint point, uint32_t lane, uint64_t number,
                            std::span<std::byte> idle_buffer = {}) {
  if (fault_hook != nullptr) fault_hook(point, lane, number, idle_buffer);
}

}  // namespace b4mrl
