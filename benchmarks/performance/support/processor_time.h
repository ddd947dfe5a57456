// Processor time, as the kernel counts it.
#pragma once

#include <sys/types.h>

namespace b4mrl::perf {

// Seconds of all threads of this process and of the processes of group `group`, in user and in
// kernel mode; those of a process that has ended are gone. Counted in steps of 10 ms. Any thread.
double ProcessorSecondsWith(pid_t group);

// Seconds of the calling thread, counted exactly.
double ThreadSeconds();

}  // namespace b4mrl::perf
