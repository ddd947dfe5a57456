// The reply to ServerStatus, which `b4mrl status` shows: counters of all processes and the
// sessions, read from shared memory. Thread rule: the gateway's main thread.
#pragma once

#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

class StatusReport {
 public:
  StatusReport(SharedState& shared, const std::string& data_folder);

  // To be called about once a second: notes the step counts that rates are computed from.
  void Sample();
  void Fill(pb::ServerStatusReply* out) const;

 private:
  struct Rate {
    uint64_t steps = 0;
    double per_second = 0;
  };
  void FillChild(uint32_t child, pb::WorkerStatus* out) const;
  void FillSessions(pb::ServerStatusReply* out) const;

  SharedState& shared_;
  std::string data_folder_;  // absolute
  std::vector<Rate> rates_;  // by child
  int64_t sampled_ms_;
};

}  // namespace b4mrl
