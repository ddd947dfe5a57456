// Clients that keep an environment worker busy, and what its other clients notice of them.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/client.h"

namespace b4mrl {

// Calls `advance` again and again on a thread of its own, from construction until Stop or its end.
class Load {
 public:
  explicit Load(std::function<Status()> advance);
  ~Load() { (void)Stop(); }
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;
  // Stop will not have to wait for more than the call under way.
  void Halt() { stop_.store(true); }
  // The first error, which ended it.
  Status Stop();
  // Calls a second from now on for so long.
  double RateFor(double seconds) const;

 private:
  std::atomic<bool> stop_{false};
  std::atomic<uint64_t> calls_{0};
  Status status_;
  std::thread thread_;  // the last member: it uses the others
};

// A client with two steps of 512 lanes of Humanoid in flight all the time.
std::unique_ptr<Load> StepHumanoids(const std::string& endpoint);
// A client with `in_flight` queries of 4,096 rows in flight all the time: Humanoids that lie folded
// up in the floor, whose every row takes a hundred times as long as a step.
std::unique_ptr<Load> AskCostlyRows(const std::string& endpoint, int in_flight,
                                    int64_t deadline_ms);

// How one lane gets on whose client waits for every answer.
struct Pace {
  double steps_per_second = 0;
  double p99_ms = 0;
};
Pace StepFor(RemoteEnvironment& session, double seconds);

double Median(std::vector<double> values);
// The median duration of `times` calls, in milliseconds.
double MedianMs(int times, const std::function<void()>& call);

// Queries of 64 rows of HalfCheetah.
class SmallQueries {
 public:
  explicit SmallQueries(Client& client);
  // How long one takes, in milliseconds: the median of `times`.
  double MedianMs(int times);

 private:
  RemoteEnvironment session_;
  std::vector<float> observations_, actions_, next_observations_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_, valid_;
};

}  // namespace b4mrl
