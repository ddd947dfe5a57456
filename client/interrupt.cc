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
  std::signal(number, SIG_DFL);
}

}  // namespace

void CatchInterrupts() {
  for (const int number : {SIGINT, SIGTERM}) {
    if (std::signal(number, OnSignal) == SIG_IGN) std::signal(number, SIG_IGN);
  }
}

const std::atomic<bool>& Interrupted() { return g_interrupted; }

int InterruptExitCode() { return 128 + g_signal; }

}  // namespace b4mrl
