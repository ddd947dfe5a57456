// Processor time, as the kernel counts it.
#pragma once

#include <sys/types.h>

namespace b4mrl::perf {

// Processor seconds, in user and kernel mode, of all threads of this process and of the processes
// of group `group` that have not ended. Counted in steps of 10 ms. Any thread.
double ProcessorSecondsWith(pid_t group);

// Processor seconds of the calling thread, counted exactly.
double ThreadSeconds();

}  // namespace b4mrl::perf
