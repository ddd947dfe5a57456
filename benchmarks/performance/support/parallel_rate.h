// Calls a second of a function that runs on all cores at once, for the bare limits.
#pragma once

#include <cstddef>
#include <functional>

namespace b4mrl::perf {

// Starts one pinned thread a core. Thread t calls make(t), and then the function that make
// returned, with 0, 1, 2, ..., until `seconds` are over. Returns the calls a second of all threads
// together.
double RateOnAllCores(double seconds,
                      const std::function<std::function<void(size_t)>(size_t)>& make);

}  // namespace b4mrl::perf
