// A session: a batch of environments ("lanes") in a worker of the daemon, with Gymnasium's step and
// reset.
//
// Shapes: n lanes, observations (n, observation size), actions (n, action size), row-major.
// Observations have the session's dtype; actions may be float or double, whatever the dtype. An
// empty list of lanes means all lanes in order. Send and Receive keep several requests for
// different lanes in flight; a lane has at most one (else kBusy). Every step is executed exactly
// once, even if the worker dies meanwhile (client/lane_numbers.h). A session that was moved from
// may only be destroyed or assigned.
//
// What an error of a Step, Reset or Restore says about the request's lanes:
//   - they are as before, and the same or another request may follow: kInvalidArgument,
//     kUnknownName, kUnsupported, kBusy, kLimitExceeded, kVersionMismatch, kFailedPrecondition, and
//     kDeadlineExceeded and kUnavailable if the daemon has said so itself;
//   - it is not known what they have executed, and they cannot be used any more, which later
//     requests for them say (kFailedPrecondition): kStale, kGap, kSessionLost, kDataLoss, kIoError;
//     kInternal, also where the daemon's reply cannot be understood; kDeadlineExceeded and
//     kUnavailable for want of a reply, or when one copy of a request that was sent twice
//     (client/connection.h) was refused and another one may have been executed.
// A Snapshot that was sent twice may still be under way when its reply comes. A Step of its lanes
// is then refused with kBusy, and is to be sent again.
//
// A session that gets no request for the daemon's lease (session_lease_ms of
// Client::hello().limits) ends: kSessionLost. Pings and the Client's requests do not keep it; a
// Snapshot of one lane now and then does, or, without lanes, a Query of one row. Thread rule: one
// thread. The Client that opened the session may end before it. The destructor closes the session.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/connection.h"
#include "client/lane_numbers.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "proto/wire/tensor.h"

namespace b4mrl {

struct EnvironmentOptions {
  // Perturbations in the order in which they apply, but `hidden` always last; without any, the true
  // environment.
  std::vector<NamedArgument> simulator;
  uint32_t num_envs = 1;         // number of lanes; 0: a session for queries alone
  std::optional<uint64_t> seed;  // lane i gets seed + i; without, the daemon draws a seed
  AutoresetMode autoreset_mode = AutoresetMode::kNextStep;
  DType observation_dtype = DType::kFloat32;
  std::string config;                                // JSON object of the environment's settings
  bool with_infos = false;                           // fills StepOutcome::infos and final_infos
  int64_t deadline_ms = limits::kDefaultDeadlineMs;  // of each request
  uint64_t ledger = 0;  // counts steps and queries (Client::OpenLedger); 0: none
};

// The outcome of a step, reset or restore: views of `reply`, which it owns. First axes are the
// request's lanes.
struct StepOutcome {
  uint64_t request_id = 0;
  TensorView observations;  // of the session's dtype
  // Rewards, terminated, truncated and causes are empty after a reset or restore.
  std::span<const double> rewards;
  std::span<const uint8_t> terminated;
  std::span<const uint8_t> truncated;
  std::span<const uint8_t> causes;    // values of Cause
  std::span<const uint64_t> digests;  // hash of each lane's trajectory; empty after a restore
  // Positions in the request of the lanes whose episode ended, then those episodes' last
  // observations, undiscounted returns and lengths in steps; all empty if no episode ended.
  std::span<const uint32_t> final_lanes;
  TensorView final_observations;
  std::span<const double> final_returns;
  std::span<const uint32_t> final_lengths;
  // Row-major, columns as in spec().info_names; empty in a session without `with_infos`.
  std::span<const double> infos;        // lanes x names
  std::span<const double> final_infos;  // ended episodes x names

  // Whether the step limit alone ended the row's episode: D4RL's timeout.
  bool timed_out(size_t row) const { return static_cast<Cause>(causes[row]) == Cause::kLimit; }
  // Whether the daemon or the physics engine gave up the step of this row: it ended its episode
  // through no rule of the task, and its observation is not an outcome of the action.
  bool given_up(size_t row) const {
    const auto cause = static_cast<Cause>(causes[row]);
    return cause == Cause::kCrash || cause == Cause::kNumericalError;
  }

  pb::Timing timing;
  ReceivedReply reply;
};

// States of lanes; the first axis of each array is the lanes. A lane restored from `snapshot`
// continues exactly, random streams included. `parts` can be read and edited, under the
// environment's own names (MuJoCo: time, qpos, qvel, qacc_warmstart). The Humanoid also has com,
// cinert, cvel, qfrc_actuator and cfrc_ext, which MuJoCo derived from the state before: erase them
// after a change of qpos or qvel, to have them derived anew.
struct LaneStates {
  size_t lanes = 0;
  std::vector<uint8_t> snapshot;                     // lanes x bytes
  std::map<std::string, std::vector<double>> parts;  // name -> lanes x size
};

// Pictures of lanes.
struct Pictures {
  uint32_t width = 0;
  uint32_t height = 0;
  std::span<const uint8_t> frames;  // lanes x height x width x (red, green, blue), top row first
  ReceivedReply reply;              // owns the frames
};

// Buffers that Query fills; row-major. The daemon computes in double and rounds to the session's
// dtype.
template <typename Scalar>
struct QueryResults {
  std::span<Scalar> next_observations;  // rows x observation size
  std::span<double> rewards;            // rows
  std::span<uint8_t> terminated;        // rows
  std::span<uint8_t> valid;             // rows; 0: the simulation failed, outputs are zeros
};
using QueryOutput = QueryResults<float>;

class RemoteEnvironment {
 public:
  const EnvironmentSpec& spec() const { return spec_; }
  // All settings of the session, seed included.
  const pb::OpenReply& in_force() const { return in_force_; }
  const std::string& experiment_id() const { return in_force_.experiment_id(); }
  uint32_t num_envs() const { return in_force_.num_envs(); }
  // The way that requests go: "door" (shared memory, on the daemon's own machine), "ipc", "tcp" or
  // "relay" (through the gateway). Changes to a socket's if the door fails.
  std::string_view transport() const { return connection_->transport(); }

  // Starts episode 0 of `seeds`, one seed for each lane; without seeds, each lane's next episode.
  Result<StepOutcome> Reset(std::span<const uint32_t> lanes = {},
                            std::span<const uint64_t> seeds = {});
  Result<StepOutcome> Step(std::span<const float> actions, std::span<const uint32_t> lanes = {});
  Result<StepOutcome> Step(std::span<const double> actions, std::span<const uint32_t> lanes = {});

  // The two halves of Step. Receive returns the outcome, or the error, of the sent request that is
  // answered first, and writes that request's id to *answered_id in either case.
  Result<uint64_t> Send(std::span<const float> actions, std::span<const uint32_t> lanes = {});
  Result<uint64_t> Send(std::span<const double> actions, std::span<const uint32_t> lanes = {});
  Result<StepOutcome> Receive(uint64_t* answered_id = nullptr);
  // The number of requests that were sent and not received.
  size_t in_flight() const { return under_way_.size(); }

  // Simulates one step from each (observation, action) row; there are as many rows as `output` has
  // rewards. Splits them into requests that are in flight together. The noise of row i is a
  // function of (seed, draw, first_row + i). Without a `draw`, it is the number of this object's
  // earlier calls without one, so that each call has noise of its own. kUnsupported with
  // action-delay.
  Status Query(std::span<const float> observations, std::span<const float> actions,
               const QueryResults<float>& output, uint64_t seed = 0,
               std::optional<uint64_t> draw = {}, uint64_t first_row = 0);
  Status Query(std::span<const double> observations, std::span<const double> actions,
               const QueryResults<double>& output, uint64_t seed = 0,
               std::optional<uint64_t> draw = {}, uint64_t first_row = 0);
  // The two halves of Query, between which the caller can work. Each SendQuery takes at most
  // limits::kMaxQueryRows rows; several may be in flight, to be received in any order, into buffers
  // of as many rows as were sent. kInvalidArgument if these have other rows: the results can still
  // be received.
  Result<uint64_t> SendQuery(std::span<const float> observations, std::span<const float> actions,
                             uint64_t seed, uint64_t draw, uint64_t first_row);
  Result<uint64_t> SendQuery(std::span<const double> observations, std::span<const double> actions,
                             uint64_t seed, uint64_t draw, uint64_t first_row);
  Status ReceiveQuery(uint64_t id, const QueryResults<float>& output);
  Status ReceiveQuery(uint64_t id, const QueryResults<double>& output);

  Result<LaneStates> Snapshot(std::span<const uint32_t> lanes = {});
  // Sets lanes to `states.snapshot`, or, if that is empty, to `states.parts`. Like a step, it is an
  // operation of those lanes and executed exactly once.
  Result<StepOutcome> Restore(const LaneStates& states, std::span<const uint32_t> lanes = {});

  // Pictures of lanes after their last operation, even if the next one is under way. The default
  // size is spec().picture_width x picture_height. A picture takes tens of milliseconds and never
  // delays a step. kUnsupported if the server cannot draw.
  Result<Pictures> Render(std::span<const uint32_t> lanes = {}, uint32_t width = 0,
                          uint32_t height = 0);

  // Drops the requests in flight and ends the session in the daemon; later calls but Close are
  // refused with kFailedPrecondition. The destructor also ends it, and waits at most half a second.
  Status Close();

 private:
  friend class Client;
  class NumberedRequest;
  // A Step, Reset or Restore that has not been received.
  struct UnderWay {
    uint64_t id;
    std::vector<uint32_t> lanes;  // empty: all lanes
  };
  // Closes the session unless Close has, then the connection.
  struct EndSession {
    bool is_open;
    void operator()(Connection* connection) const;
  };
  RemoteEnvironment(Connection connection, pb::OpenReply in_force, EnvironmentSpec spec,
                    int64_t deadline_ms);

  template <typename Scalar>
  Result<uint64_t> SendActions(std::span<const Scalar> actions, std::span<const uint32_t> lanes);
  std::vector<UnderWay>::iterator FindUnderWay(uint64_t id);
  // Ends the operation in numbers_ by what its delivery says.
  Result<StepOutcome> Finish(Delivery delivery, bool is_step);
  Result<StepOutcome> ReceiveNumbered(uint64_t id, bool is_step);
  // kInternal for a reply whose arrays do not have `rows` rows, one for each lane of the request.
  Result<StepOutcome> ReadOutcome(ReceivedReply reply, uint64_t rows, bool is_step) const;

  template <typename Scalar>
  Result<uint64_t> SendRows(std::span<const Scalar> observations, std::span<const Scalar> actions,
                            uint64_t seed, uint64_t draw, uint64_t first_row);
  template <typename Scalar>
  Status ReceiveRows(uint64_t id, const QueryResults<Scalar>& output);
  template <typename Scalar>
  Status QueryRows(std::span<const Scalar> observations, std::span<const Scalar> actions,
                   const QueryResults<Scalar>& output, uint64_t seed, std::optional<uint64_t> draw,
                   uint64_t first_row);
  Deadline NewDeadline() const { return Deadline::AfterMs(deadline_ms_); }

  std::unique_ptr<Connection, EndSession> connection_;
  pb::OpenReply in_force_;
  EnvironmentSpec spec_;
  int64_t deadline_ms_;
  LaneNumbers numbers_;
  std::vector<UnderWay> under_way_;
  std::map<uint64_t, uint64_t> query_rows_;  // of each query that was sent and not received
  uint64_t next_draw_ = 0;                   // of a query without a draw
};

}  // namespace b4mrl
