// Steps a session with actions that are a function of (lane, step), several requests in flight, and
// keeps every byte that came back for each lane, so that two runs can be compared whatever happened
// in between.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "client/client.h"

namespace b4mrl {

class LaneWalk {
 public:
  // Opens a HalfCheetah session of `groups` x `lanes_per_group` lanes with short episodes, so that
  // resets and ends are part of every walk. One request per group is in flight.
  static Result<LaneWalk> Open(Client& client, uint32_t groups, uint32_t lanes_per_group,
                               uint64_t seed);

  Status Reset();
  // Receives one reply, records it, and sends its group's next step. The first call sends all
  // groups.
  Status Advance();
  // Receives what is in flight.
  Status Drain();
  // Runs every group to `steps` steps.
  Status RunTo(uint64_t steps);

  RemoteEnvironment& environment() { return environment_; }
  // The steps that every group has finished.
  uint64_t FinishedSteps() const;
  // Bytes of the first `steps` steps of lane `lane`: observation, reward, flags, cause, digest, and
  // the final observation, return and length where there were any.
  std::string Bytes(uint32_t lane, uint64_t steps) const;
  // A hash of these bytes of all lanes.
  uint64_t Hash(uint64_t steps) const;
  const std::vector<uint8_t>& causes(uint32_t lane) const { return causes_[lane]; }

 private:
  LaneWalk(RemoteEnvironment environment, uint32_t groups, uint32_t lanes_per_group);
  Status SendStep(uint32_t group);
  Status ReceiveOne(uint32_t* group);
  void Record(uint32_t group, const StepOutcome& outcome);
  std::vector<uint32_t> LanesOf(uint32_t group) const;

  RemoteEnvironment environment_;
  uint32_t lanes_per_group_;
  std::vector<uint64_t> sent_;      // by group
  std::vector<uint64_t> finished_;  // by group
  std::map<uint64_t, uint32_t> group_of_request_;
  std::vector<std::vector<std::string>> records_;  // by lane, then step
  std::vector<std::vector<uint8_t>> causes_;
};

}  // namespace b4mrl
