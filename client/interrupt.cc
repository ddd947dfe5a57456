#include "client/interrupt.h"

#include <csignal>

namespace b4mrl {
namespace {

std::atomic<bool> g_interrupted = false;
std::atomic<int> g_signal = SIGINT;
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

void OnSignal(int number) {
  g_signal = number;
  g_interrupted = true;
  // A SIGTERM comes twice where a service manager or Slurm sends one to every process and so does
  // the parent, and the first is to end the work in order.
  if (number == SIGINT) std::signal(number, SIG_DFL);
}

}  // namespace

void CatchInterrupts() {
  for (const int number : {SIGINT, SIGTERM}) {
    if (std::signal(number, OnSignal) == SIG_IGN) std::signal(number, SIG_IGN);
  }
}

const std::atomic<bool>& Interrupted() { return g_interrupted; }

Status UnlessInterrupted() {
  return g_interrupted ? Status(StatusCode::kUnavailable, "interrupted") : Status();
}

int InterruptExitCode() { return 128 + g_signal; }

}  // namespace b4mrl
