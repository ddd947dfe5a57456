#include "benchmarks/performance/support/parallel_rate.h"

#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "proto/base/clock.h"
#include "proto/base/cores.h"

namespace b4mrl::perf {

double RateOnAllCores(double seconds,
                      const std::function<std::function<void(size_t)>(size_t)>& make) {
  const std::vector<int> cores = AvailableCores();
  std::atomic<size_t> ready{0};
  std::atomic<bool> stop{false};
  std::atomic<size_t> total{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < cores.size(); ++t) {
    threads.emplace_back([&, t] {
      PinThisThread({cores[t]});
      const std::function<void(size_t)> one = make(t);
      ready.fetch_add(1);
      while (ready.load() < cores.size()) std::this_thread::yield();
      size_t count = 0;
      while (!stop.load(std::memory_order_relaxed)) one(count++);
      total.fetch_add(count);
    });
  }
  while (ready.load() < cores.size()) std::this_thread::yield();
  const Clock::time_point start = Clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  stop.store(true);
  for (std::thread& thread : threads) thread.join();
  return static_cast<double>(total.load()) / SecondsSince(start);
}

}  // namespace b4mrl::perf
