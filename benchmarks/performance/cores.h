// The processor cores that this process may use.
#pragma once

#include <vector>

namespace b4mrl::perf {

// Their numbers, ascending; never empty.
std::vector<int> AvailableCores();
// Keeps the calling thread on one core. Failing to is no error: the measurement is only noisier.
void PinThisThread(int core);

}  // namespace b4mrl::perf
