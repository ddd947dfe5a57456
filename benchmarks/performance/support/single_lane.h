// One lane of HalfCheetah behind a daemon, stepped by a client that waits for every answer.
#pragma once

#include <vector>

#include "client/client.h"
#include "client/remote_environment.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

class SingleLane {
 public:
  // Opens the lane and resets it.
  static Result<SingleLane> Open(Client& client);

  // Makes `steps` steps; the microseconds that each step took.
  Result<std::vector<double>> StepTimes(int steps);
  // Their median.
  Result<double> MedianStepTime(int steps);
  Result<StepOutcome> Step();

 private:
  SingleLane(RemoteEnvironment environment, std::vector<float> actions)
      : environment_(std::move(environment)), actions_(std::move(actions)) {}

  RemoteEnvironment environment_;
  std::vector<float> actions_;
  size_t next_row_ = 0;
};

}  // namespace b4mrl::perf
