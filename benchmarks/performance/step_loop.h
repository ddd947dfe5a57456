// 64 lanes stepped through the daemon by one client thread that keeps two requests in flight. One
// thread.
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "client/client.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

class StepLoop {
 public:
  static constexpr uint32_t kLanes = 64;
  static constexpr uint32_t kRequestsInFlight = 2;

  static Result<StepLoop> Open(Client& client, const std::string& environment,
                               const std::vector<NamedArgument>& simulator = {});

  size_t action_size() const { return environment_.spec().action.size(); }
  // Rows of action_size(), used in turn; at least kLanes of them, in multiples of that.
  void UseActions(std::vector<float> actions) { actions_ = std::move(actions); }
  // Lane steps a second over about `seconds`.
  Result<double> Rate(double seconds);

 private:
  explicit StepLoop(RemoteEnvironment environment);
  Status Send(uint32_t group);

  RemoteEnvironment environment_;
  std::vector<float> actions_;
  std::vector<uint32_t> lanes_;
  std::unordered_map<uint64_t, uint32_t> group_of_;  // by request id
  size_t next_ = 0;                                  // in actions_
};

}  // namespace b4mrl::perf
