// A session: a batch of environments ("lanes") in a worker of the daemon, stepped as Gymnasium's
// are.
//
// Shapes: n lanes, observations (n, observation size), actions (n, action size), row-major.
// Observations come in the session's dtype; actions may be float or double, whatever the dtype.
// Calls take all lanes, in order, or a list of them. Send and Receive keep several requests for
// different lanes in flight; a lane has at most one (else kBusy). Every step is executed exactly
// once, even if the worker dies in between (client/lane_numbers.h). A refused request has changed
// nothing. After kDeadlineExceeded or kUnavailable without an answer, kInternal, kStale, kGap and
// kSessionLost the lanes of that request are of no more use. Thread rule: one thread. The Client
// that made it outlives it. Its end closes the session.
#pragma once

#include <cstdint>
#include <map>
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
  // Perturbations, applied in order; none: the true environment.
  std::vector<NamedArgument> simulator;
  uint32_t num_envs = 1;         // 0: for queries alone
  std::optional<uint64_t> seed;  // lane i gets seed + i; none: the daemon draws one
  AutoresetMode autoreset_mode = AutoresetMode::kNextStep;
  DType observation_dtype = DType::kFloat32;
  std::string config;                                // JSON object of the environment's settings
  bool with_infos = false;                           // fills StepOutcome::infos and final_infos
  int64_t deadline_ms = limits::kDefaultDeadlineMs;  // of each request
};

// The outcome of a step or reset; views into `reply`, which it owns. First axes are the request's
// lanes.
struct StepOutcome {
  uint64_t request_id = 0;
  TensorView observations;          // the session's dtype
  std::span<const double> rewards;  // empty after a reset, like all up to `digests`
  std::span<const uint8_t> terminated;
  std::span<const uint8_t> truncated;
  std::span<const uint8_t> causes;    // Cause
  std::span<const uint64_t> digests;  // rolling hash of each lane's trajectory; not of a Restore
  // Lanes whose episode ended, as positions in the request, with what they ended in; empty if none
  // did.
  std::span<const uint32_t> final_lanes;
  TensorView final_observations;
  std::span<const double> final_returns;
  std::span<const uint32_t> final_lengths;
  // Row-major, columns as in spec().info_names; empty unless asked for.
  std::span<const double> infos;        // lanes x names
  std::span<const double> final_infos;  // ended episodes x names
  pb::Timing timing;
  ReceivedReply reply;
};

// States to read and to write, first axis the lanes. `snapshot` continues exactly, random streams
// included; `parts` are for users: the environment's own names (MuJoCo: time, qpos, qvel,
// qacc_warmstart).
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
  ReceivedReply reply;              // owns them
};

// Where Query writes; row-major. The daemon computes in double and rounds to the session's dtype.
template <typename Scalar>
struct QueryResults {
  std::span<Scalar> next_observations;  // rows x observation size
  std::span<double> rewards;            // rows
  std::span<uint8_t> terminated;        // rows
  std::span<uint8_t> valid;             // rows; 0: outputs are zeros and the row is of no use
};
using QueryOutput = QueryResults<float>;

class RemoteEnvironment {
 public:
  RemoteEnvironment(RemoteEnvironment&& other) noexcept;
  RemoteEnvironment& operator=(RemoteEnvironment&& other) noexcept;
  ~RemoteEnvironment();

  const EnvironmentSpec& spec() const { return spec_; }
  const pb::OpenReply& in_force() const { return in_force_; }  // everything, seed included
  const std::string& experiment_id() const { return in_force_.experiment_id(); }
  uint32_t num_envs() const { return in_force_.num_envs(); }

  // `seeds` (as many as lanes) restart those lanes' random streams; none: the next episode.
  Result<StepOutcome> Reset(std::span<const uint32_t> lanes = {},
                            std::span<const uint64_t> seeds = {});
  Result<StepOutcome> Step(std::span<const float> actions, std::span<const uint32_t> lanes = {});
  Result<StepOutcome> Step(std::span<const double> actions, std::span<const uint32_t> lanes = {});

  // The two halves of Step. Receive returns whichever sent request is answered first; an error
  // names its request in *failed_id.
  Result<uint64_t> Send(std::span<const float> actions, std::span<const uint32_t> lanes = {});
  Result<uint64_t> Send(std::span<const double> actions, std::span<const uint32_t> lanes = {});
  Result<StepOutcome> Receive(uint64_t* failed_id = nullptr);
  // Requests of Send that Receive has not returned.
  size_t in_flight() const { return under_way_.size(); }

  // T_sim for arbitrary (observation, action) rows, as many as `output` has rewards, split into
  // requests that are in flight together. Noise of row i is that of (seed, draw, first_row + i).
  // kUnsupported with action-delay.
  Status Query(std::span<const float> observations, std::span<const float> actions,
               const QueryResults<float>& output, uint64_t seed = 0, uint64_t draw = 0,
               uint64_t first_row = 0);
  Status Query(std::span<const double> observations, std::span<const double> actions,
               const QueryResults<double>& output, uint64_t seed = 0, uint64_t draw = 0,
               uint64_t first_row = 0);
  // The same in two halves, so that the caller can work meanwhile: at most
  // limits::kMaxQueryRows rows a request, several requests in flight, answers in any order.
  Result<uint64_t> SendQuery(std::span<const float> observations, std::span<const float> actions,
                             uint64_t seed, uint64_t draw, uint64_t first_row);
  Result<uint64_t> SendQuery(std::span<const double> observations, std::span<const double> actions,
                             uint64_t seed, uint64_t draw, uint64_t first_row);
  Status ReceiveQuery(uint64_t id, const QueryResults<float>& output);
  Status ReceiveQuery(uint64_t id, const QueryResults<double>& output);

  Result<LaneStates> Snapshot(std::span<const uint32_t> lanes = {});
  // From `states.snapshot` if it has one, otherwise from its parts. Counts as a step of those
  // lanes.
  Result<StepOutcome> Restore(const LaneStates& states, std::span<const uint32_t> lanes = {});

  // What lanes look like after their last operation, even if the next one is under way. Without a
  // size the environment's own: spec().picture_width x picture_height. Takes tens of milliseconds a
  // lane and never delays a step. kUnsupported where the server cannot draw.
  Result<Pictures> Render(std::span<const uint32_t> lanes = {}, uint32_t width = 0,
                          uint32_t height = 0);

  // Abandons what is in flight and ends the session in the daemon. The destructor does it too, and
  // waits at most half a second.
  Status Close();

 private:
  friend class Client;
  class NumberedRequest;
  // A Step, Reset or Restore that has not been received.
  struct UnderWay {
    uint64_t id;
    std::vector<uint32_t> lanes;  // empty: all
  };
  RemoteEnvironment(Connection connection, pb::OpenReply in_force, EnvironmentSpec spec,
                    int64_t deadline_ms);

  template <typename Scalar>
  Result<uint64_t> SendActions(std::span<const Scalar> actions, std::span<const uint32_t> lanes);
  std::vector<UnderWay>::iterator FindUnderWay(uint64_t id);
  // Settles the lanes' numbers.
  Result<ReceivedReply> Finish(Delivery delivery);
  Result<ReceivedReply> ReceiveNumbered(uint64_t id);
  // Refuses a reply whose arrays have other than `rows` rows, one for each lane of the request.
  Result<StepOutcome> ReadOutcome(Result<ReceivedReply> reply, uint64_t rows, bool is_step) const;

  template <typename Scalar>
  Result<uint64_t> SendRows(std::span<const Scalar> observations, std::span<const Scalar> actions,
                            uint64_t seed, uint64_t draw, uint64_t first_row);
  template <typename Scalar>
  Status ReceiveRows(uint64_t id, const QueryResults<Scalar>& output);
  template <typename Scalar>
  Status QueryRows(std::span<const Scalar> observations, std::span<const Scalar> actions,
                   const QueryResults<Scalar>& output, uint64_t seed, uint64_t draw,
                   uint64_t first_row);
  void EndSession();
  Deadline NewDeadline() const { return Deadline::AfterMs(deadline_ms_); }

  Connection connection_;
  pb::OpenReply in_force_;
  EnvironmentSpec spec_;
  int64_t deadline_ms_;
  LaneNumbers numbers_;
  std::vector<UnderWay> under_way_;
  bool open_ = true;
};

}  // namespace b4mrl
