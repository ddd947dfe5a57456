// 64 lanes stepped through the daemon by one client thread that keeps some requests in flight. One
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

  // The lanes are split over `requests` requests, a divisor of kLanes. More requests hide the
  // client's work behind the daemon's; fewer requests cost the client less work.
  static Result<StepLoop> Open(Client& client, const std::string& environment,
                               const std::vector<NamedArgument>& simulator = {},
                               uint32_t requests = 2);

  size_t action_size() const { return environment_.spec().action.size(); }
  // Rows of action_size() numbers, used in turn: a multiple of kLanes rows.
  void UseActions(std::vector<float> actions) { actions_ = std::move(actions); }
  // Steps lanes for about `seconds`; returns the lane steps a second.
  Result<double> Rate(double seconds);

 private:
  StepLoop(RemoteEnvironment environment, uint32_t requests);
  Status Send(uint32_t group);

  RemoteEnvironment environment_;
  std::vector<float> actions_;
  std::vector<uint32_t> lanes_;
  uint32_t requests_;
  std::unordered_map<uint64_t, uint32_t> group_of_;  // by request id
  size_t next_ = 0;                                  // index into actions_
};

}  // namespace b4mrl::perf
