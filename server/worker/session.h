// A session in the worker that hosts it: its simulator, its lanes' numbers, its requests in flight.
//
// Built from the session's record in shared memory, for a new session as well as by the replacement
// of a dead worker. Thread rule: the socket's thread, except for what the pool reads: the stepper,
// slots and sizes, which never change, and the costs, which are atomic.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "proto/b4mrl.pb.h"
#include "proto/base/clock.h"
#include "server/process/memory_shares.h"
#include "server/replies/reply.h"
#include "server/scheduling/item_cost.h"
#include "server/shared_memory/shared_state.h"
#include "server/simulator/lane_stepper.h"
#include "server/simulator/simulator.h"

namespace b4mrl {

class RequestJob;

// What the socket's thread knows of a lane without reading the lane's slot.
struct LaneStatus {
  uint64_t committed = 0;                  // number of the last committed operation
  Operation operation = Operation::kNone;  // kind of that operation
  bool fresh = true;                       // the lane was never reset or restored
  const RequestJob* busy = nullptr;        // the job that executes the lane now
};

enum class LaneVerdict { kExecute, kAnswerFromSlot };
// The rule of exactly once for one lane. With c = status.committed: number c + 1 is executed,
// number c answered from the slot if it was the same operation, a smaller number kStale, a greater
// one kGap. A lane that executes another operation is kBusy. `lane` is for the error message.
Result<LaneVerdict> JudgeLane(const LaneStatus& status, uint32_t lane, uint64_t number,
                              Operation operation);

class Session {
 public:
  // Reads record `index`. The lanes of a session that is kOpening are made anew; those of a session
  // that is kLive are verified and taken over. kSessionLost if the record does not have
  // `generation` throughout; other errors name what is wrong with the request or the record.
  static Result<std::unique_ptr<Session>> Build(SharedState& shared, uint32_t index,
                                                uint64_t generation);

  uint32_t index() const { return index_; }
  const std::string& token() const { return token_; }
  uint64_t generation() const { return generation_; }
  SessionRecord& record() const { return shared_.session(index_); }
  // The state of the record; kFree if the record belongs to another session by now.
  SessionState state() const;
  // False once the session is closed or the gateway has taken its record back.
  bool owns_record() const {
    return state() == SessionState::kOpening || state() == SessionState::kLive;
  }
  // Whether the gateway has acknowledged the session. Only then are its requests served.
  bool live() const { return state() == SessionState::kLive; }
  // What the client asked for, with the seed filled in.
  const pb::OpenRequest& request() const { return request_; }
  const Simulator& simulator() const { return stepper_.simulator(); }
  const LaneStepper& stepper() const { return stepper_; }
  // What simulator() was opened with, so that the painter's process can open the same simulator.
  const SimulatorRequest& simulator_request() const { return simulator_request_; }
  const LaneLayout& layout() const { return stepper_.layout(); }
  // kFloat32 or kFloat64.
  DType observation_dtype() const { return observation_dtype_; }
  // Columns of `infos` in the replies to Step and Reset; 0 unless the client asked for them.
  size_t reported_infos() const { return request_.with_infos() ? layout().info_size : 0; }
  // A hash of all that decides the session's numbers: environment, model, perturbations, settings,
  // seed, lanes and engine version.
  const std::string& experiment_id() const { return experiment_id_; }

  uint32_t lane_count() const { return static_cast<uint32_t>(lanes_.size()); }
  uint32_t global_lane(uint32_t lane) const { return first_lane_ + lane; }
  LaneSlot slot(uint32_t lane) const { return shared_.lane(first_lane_ + lane); }
  ConstLaneRecord committed_record(uint32_t lane) const {
    return ConstLaneRecord(layout(), slot(lane).committed_record().data());
  }
  LaneStatus& lane(uint32_t lane) { return lanes_[lane]; }
  // Updates lane(`lane`) from its slot after an operation.
  void RefreshLane(uint32_t lane);

  // The jobs under way, by request id.
  std::unordered_map<uint64_t, RequestJob*>& in_flight() { return in_flight_; }
  const std::unordered_map<uint64_t, RequestJob*>& in_flight() const { return in_flight_; }
  size_t requests_in_flight() const { return in_flight_.size(); }
  // The cost of one item of this session's requests of that kind.
  ItemCost& cost(pb::Request::PayloadCase kind) { return costs_[kind]; }

  // What the Renders under way of all sessions of the worker hold for their pictures and states.
  // The worker's, set before the first request.
  SharedBytes* pictures = nullptr;

  // A Close that waits for the requests in flight.
  struct PendingClose {
    Asker from;
    Deadline deadline;
  };
  std::vector<PendingClose> pending_closes;
  // Adds a Close to pending_closes, or gives its earlier copy there the sender and the deadline of
  // this one. False: too many wait already.
  bool AddClose(PendingClose close);
  // Set by the first Close; the session ends with its last request in flight.
  bool closing = false;
  // Takes the senders of the Closes whose deadline is not after `now`. Sets *next to the next
  // deadline of the others where that is earlier.
  std::vector<Asker> TakeLateCloses(Clock::time_point now, Clock::time_point* next);

 private:
  Session(SharedState& shared, uint32_t index, LaneStepper stepper)
      : shared_(shared), index_(index), stepper_(std::move(stepper)) {}
  void InitializeLanes();
  Status AdoptLanes();
  void NameExperiment();

  SharedState& shared_;
  uint32_t index_;
  LaneStepper stepper_;
  SimulatorRequest simulator_request_;
  std::string token_;
  uint64_t generation_ = 0;
  uint32_t first_lane_ = 0;
  pb::OpenRequest request_;
  DType observation_dtype_ = DType::kFloat32;
  std::string experiment_id_;
  std::vector<LaneStatus> lanes_;
  std::unordered_map<uint64_t, RequestJob*> in_flight_;
  std::map<pb::Request::PayloadCase, ItemCost> costs_;
};

}  // namespace b4mrl
