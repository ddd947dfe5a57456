// How often a second something can be done on all cores at once, for the bare limits.
#pragma once

#include <cstddef>
#include <functional>

namespace b4mrl::perf {

// Starts one pinned thread a core; thread t calls make(t), then the result with 0, 1, 2, ... until
// `seconds` are over. Calls a second, all threads together.
double RateOnAllCores(double seconds,
                      const std::function<std::function<void(size_t)>(size_t)>& make);

}  // namespace b4mrl::perf
