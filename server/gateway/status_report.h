// The reply to ServerStatus, which `b4mrl status` shows: counters of all processes and the
// sessions, read from shared memory. Thread rule: the gateway's main thread.
#pragma once

#include <string>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "server/gateway/data_folder.h"
#include "server/shared_memory/shared_state.h"

namespace b4mrl {

class StatusReport {
 public:
  // What is passed by reference outlives the report.
  StatusReport(SharedState& shared, DataFolder& data_folder);

  // To be called about once a second: notes the step counts that rates are computed from.
  void Sample();
  void Fill(pb::ServerStatusReply* out);

 private:
  struct Rate {
    uint64_t steps = 0;
    double per_second = 0;
  };
  // What is shown of an Open that a record holds.
  struct Opened {
    uint64_t generation = 0;  // of the record when it was read; no session has 0
    bool is_whole = false;    // the record is not damaged
    std::string environment;
    std::string perturbations;
  };
  void FillChild(uint32_t child, pb::WorkerStatus* out) const;
  void FillSessions(pb::ServerStatusReply* out);
  // Reads each session's record once: hashing and parsing all of them takes milliseconds, and any
  // client may ask for the status again and again.
  const Opened& OpenedOf(uint32_t index);

  SharedState& shared_;
  DataFolder& data_folder_;
  std::vector<Rate> rates_;     // by child
  std::vector<Opened> opened_;  // by index of the record
  int64_t sampled_ms_;
};

}  // namespace b4mrl
