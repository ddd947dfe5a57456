#include "client/remote_environment.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <deque>
#include <numeric>
#include <utility>

namespace b4mrl {
namespace {

// Requests of one Query call that are under way at once: enough to keep every thread of a worker
// busy while one answer is copied out.
constexpr size_t kQueryRequestsInFlight = 6;

template <typename T>
void CopyArray(std::span<const T> values, Frame& payload, size_t offset) {
  std::memcpy(payload.data() + offset, values.data(), values.size_bytes());
}

template <typename T>
Result<std::span<const T>> ReadColumn(const ArrayReader& arrays, std::string_view name,
                                      uint64_t rows) {
  B4MRL_ASSIGN_OR_RETURN(const TensorView view, arrays.Require(name, {DTypeOf<T>()}, {rows}));
  return view.As<T>();
}

// True where a reply's optional array is there and well-formed, or is not there at all.
bool IsStatePart(std::string_view name) {
  return name == "time" || name == "qpos" || name == "qvel" || name == "qacc_warmstart";
}

}  // namespace

// A request for `lanes` (none: all) under construction: its arrays, and the next number of each
// lane.
class RemoteEnvironment::NumberedRequest {
 public:
  NumberedRequest(RemoteEnvironment& session, std::span<const uint32_t> lanes)
      : session_(session), lanes_(lanes), layout_(request_.mutable_arrays()) {
    const uint64_t count = session.CountOf(lanes);
    numbers_offset_ = layout_.Add("numbers", DType::kUint64, {count});
    if (!lanes.empty()) lanes_offset_ = layout_.Add("lanes", DType::kUint32, {count});
  }
  pb::Request& request() { return request_; }
  // A further array of whole rows; `values` must live until Send.
  template <typename T>
  void Add(std::string_view name, std::span<const T> values,
           std::initializer_list<uint64_t> shape) {
    const size_t offset = layout_.Add(name, DTypeOf<T>(), shape);
    parts_[part_count_++] = {offset, values.data(), values.size_bytes()};
  }
  // Counts the lanes' numbers on only if the request was queued.
  Result<uint64_t> Send() {
    Frame payload = layout_.Allocate();
    const size_t count = session_.CountOf(lanes_);
    const std::span<uint64_t> numbers = ArrayAt<uint64_t>(payload, numbers_offset_, count);
    for (size_t i = 0; i < count; ++i) numbers[i] = session_.numbers_[LaneAt(i)] + 1;
    if (!lanes_.empty()) CopyArray(lanes_, payload, lanes_offset_);
    for (size_t i = 0; i < part_count_; ++i) {
      std::memcpy(payload.data() + parts_[i].offset, parts_[i].data, parts_[i].bytes);
    }
    Result<uint64_t> id =
        session_.connection_.Send(std::move(request_), std::move(payload), session_.NewDeadline());
    if (id.ok()) {
      for (size_t i = 0; i < count; ++i) ++session_.numbers_[LaneAt(i)];
    }
    return id;
  }

 private:
  struct Part {
    size_t offset;
    const void* data;
    size_t bytes;
  };
  size_t LaneAt(size_t i) const { return lanes_.empty() ? i : lanes_[i]; }

  RemoteEnvironment& session_;
  std::span<const uint32_t> lanes_;
  pb::Request request_;
  ArrayLayout layout_;
  size_t numbers_offset_ = 0;
  size_t lanes_offset_ = 0;
  std::array<Part, 8> parts_{};
  size_t part_count_ = 0;
};

RemoteEnvironment::RemoteEnvironment(Connection connection, pb::OpenReply in_force,
                                     EnvironmentSpec spec, int64_t deadline_ms)
    : connection_(std::move(connection)),
      in_force_(std::move(in_force)),
      spec_(std::move(spec)),
      deadline_ms_(deadline_ms),
      numbers_(in_force_.num_envs(), 0) {}

RemoteEnvironment::~RemoteEnvironment() {
  // A moved-from session has no token left to close.
  if (!open_ || in_force_.environment().empty()) return;
  pb::Request request;
  request.mutable_close();
  (void)connection_.Call(std::move(request), Frame(), Deadline::AfterMs(500));
}

Status RemoteEnvironment::CheckLanes(std::span<const uint32_t> lanes) const {
  for (const uint32_t lane : lanes) {
    if (lane >= numbers_.size()) {
      return InvalidNumber("lane", lane, fmt::format("0..{}", numbers_.size() - 1));
    }
  }
  return Status();
}

Result<StepOutcome> RemoteEnvironment::Reset(std::span<const uint32_t> lanes,
                                             std::span<const uint64_t> seeds) {
  B4MRL_RETURN_IF_ERROR(CheckLanes(lanes));
  if (!seeds.empty() && seeds.size() != CountOf(lanes)) {
    return InvalidNumber("number of seeds", static_cast<double>(seeds.size()),
                         fmt::format("{}, one a lane", CountOf(lanes)));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_reset();
  if (!seeds.empty()) request.Add("seeds", seeds, {seeds.size()});
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, request.Send());
  return ReadOutcome(connection_.Receive(id), /*is_step=*/false);
}

template <typename Scalar>
Result<uint64_t> RemoteEnvironment::SendActions(std::span<const Scalar> actions,
                                                std::span<const uint32_t> lanes) {
  B4MRL_RETURN_IF_ERROR(CheckLanes(lanes));
  const size_t count = CountOf(lanes);
  if (actions.size() != count * spec_.action.size()) {
    return InvalidNumber("number of action values", static_cast<double>(actions.size()),
                         fmt::format("{} lanes x {}", count, spec_.action.size()));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_step();
  request.Add("actions", actions, {count, spec_.action.size()});
  return request.Send();
}

Result<uint64_t> RemoteEnvironment::Send(std::span<const float> actions,
                                         std::span<const uint32_t> lanes) {
  return SendActions(actions, lanes);
}
Result<uint64_t> RemoteEnvironment::Send(std::span<const double> actions,
                                         std::span<const uint32_t> lanes) {
  return SendActions(actions, lanes);
}

Result<StepOutcome> RemoteEnvironment::Step(std::span<const float> actions,
                                            std::span<const uint32_t> lanes) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, SendActions(actions, lanes));
  return ReadOutcome(connection_.Receive(id), /*is_step=*/true);
}
Result<StepOutcome> RemoteEnvironment::Step(std::span<const double> actions,
                                            std::span<const uint32_t> lanes) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, SendActions(actions, lanes));
  return ReadOutcome(connection_.Receive(id), /*is_step=*/true);
}

Result<StepOutcome> RemoteEnvironment::Receive(uint64_t* failed_id) {
  uint64_t id = 0;
  Result<ReceivedReply> reply = connection_.ReceiveAny(&id);
  if (!reply.ok() && failed_id != nullptr) *failed_id = id;
  return ReadOutcome(std::move(reply), /*is_step=*/true);
}

Result<StepOutcome> RemoteEnvironment::ReadOutcome(Result<ReceivedReply> reply,
                                                   bool is_step) const {
  if (!reply.ok()) return reply.status();
  StepOutcome outcome;
  outcome.reply = std::move(*reply);
  outcome.request_id = outcome.reply.request_id;
  outcome.timing = outcome.reply.envelope.timing();
  const ArrayReader& arrays = outcome.reply.arrays;
  const DType dtype = static_cast<DType>(in_force_.observation_dtype());
  const uint64_t size = spec_.observation.size();
  B4MRL_ASSIGN_OR_RETURN(outcome.observations,
                         arrays.Require("observations", {dtype}, {ArrayReader::kAny, size}));
  const uint64_t rows = outcome.observations.rows();
  if (arrays.Has("digests")) {
    B4MRL_ASSIGN_OR_RETURN(outcome.digests, ReadColumn<uint64_t>(arrays, "digests", rows));
  }
  if (!is_step) return outcome;
  B4MRL_ASSIGN_OR_RETURN(outcome.rewards, ReadColumn<double>(arrays, "rewards", rows));
  B4MRL_ASSIGN_OR_RETURN(outcome.terminated, ReadColumn<uint8_t>(arrays, "terminated", rows));
  B4MRL_ASSIGN_OR_RETURN(outcome.truncated, ReadColumn<uint8_t>(arrays, "truncated", rows));
  B4MRL_ASSIGN_OR_RETURN(outcome.causes, ReadColumn<uint8_t>(arrays, "cause", rows));
  const TensorView* final_lanes = arrays.Find("final_lanes");
  if (final_lanes == nullptr) return outcome;
  const uint64_t ended = final_lanes->rows();
  B4MRL_ASSIGN_OR_RETURN(outcome.final_lanes, ReadColumn<uint32_t>(arrays, "final_lanes", ended));
  B4MRL_ASSIGN_OR_RETURN(outcome.final_observations,
                         arrays.Require("final_observations", {dtype}, {ended, size}));
  B4MRL_ASSIGN_OR_RETURN(outcome.final_returns, ReadColumn<double>(arrays, "final_returns", ended));
  B4MRL_ASSIGN_OR_RETURN(outcome.final_lengths,
                         ReadColumn<uint32_t>(arrays, "final_lengths", ended));
  return outcome;
}

Result<uint64_t> RemoteEnvironment::SendQuery(std::span<const float> observations,
                                              std::span<const float> actions, uint64_t seed,
                                              uint64_t draw, uint64_t first_row) {
  const uint64_t rows = actions.size() / spec_.action.size();
  if (actions.size() != rows * spec_.action.size() ||
      observations.size() != rows * spec_.observation.size()) {
    return InvalidNumber("number of observation values", static_cast<double>(observations.size()),
                         fmt::format("{} rows x {}", rows, spec_.observation.size()));
  }
  pb::Request request;
  pb::QueryRequest* query = request.mutable_query();
  query->set_seed(seed);
  query->set_draw(draw);
  query->set_first_row(first_row);
  ArrayLayout layout(request.mutable_arrays());
  const size_t observations_offset =
      layout.Add("observations", DType::kFloat32, {rows, spec_.observation.size()});
  const size_t actions_offset = layout.Add("actions", DType::kFloat32, {rows, spec_.action.size()});
  Frame payload = layout.Allocate();
  CopyArray(observations, payload, observations_offset);
  CopyArray(actions, payload, actions_offset);
  return connection_.Send(std::move(request), std::move(payload), NewDeadline());
}

Status RemoteEnvironment::ReceiveQuery(uint64_t id, const QueryOutput& output) {
  B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply, connection_.Receive(id));
  const uint64_t rows = output.rewards.size();
  const uint64_t size = spec_.observation.size();
  B4MRL_ASSIGN_OR_RETURN(
      const TensorView next,
      reply.arrays.Require("next_observations", {DType::kFloat32, DType::kFloat64}, {rows, size}));
  B4MRL_ASSIGN_OR_RETURN(const auto rewards, ReadColumn<double>(reply.arrays, "rewards", rows));
  B4MRL_ASSIGN_OR_RETURN(const auto terminated,
                         ReadColumn<uint8_t>(reply.arrays, "terminated", rows));
  B4MRL_ASSIGN_OR_RETURN(const auto valid, ReadColumn<uint8_t>(reply.arrays, "valid", rows));
  if (next.dtype == DType::kFloat32) {
    std::ranges::copy(next.As<float>(), output.next_observations.begin());
  } else {
    std::ranges::transform(next.As<double>(), output.next_observations.begin(),
                           [](double x) { return static_cast<float>(x); });
  }
  std::ranges::copy(rewards, output.rewards.begin());
  std::ranges::copy(terminated, output.terminated.begin());
  std::ranges::copy(valid, output.valid.begin());
  return Status();
}

Status RemoteEnvironment::Query(std::span<const float> observations, std::span<const float> actions,
                                const QueryOutput& output, uint64_t seed, uint64_t draw,
                                uint64_t first_row) {
  struct Chunk {
    uint64_t id;
    size_t first;
    size_t rows;
  };
  const size_t rows = output.rewards.size();
  const size_t observation_size = spec_.observation.size();
  const size_t action_size = spec_.action.size();
  std::deque<Chunk> chunks;
  size_t next = 0;
  while (next < rows || !chunks.empty()) {
    if (next < rows && chunks.size() < kQueryRequestsInFlight) {
      const size_t count = std::min<size_t>(rows - next, limits::kMaxQueryRows);
      B4MRL_ASSIGN_OR_RETURN(
          const uint64_t id,
          SendQuery(observations.subspan(next * observation_size, count * observation_size),
                    actions.subspan(next * action_size, count * action_size), seed, draw,
                    first_row + next));
      chunks.push_back({id, next, count});
      next += count;
      continue;
    }
    const Chunk chunk = chunks.front();
    chunks.pop_front();
    B4MRL_RETURN_IF_ERROR(
        ReceiveQuery(chunk.id, {output.next_observations.subspan(chunk.first * observation_size,
                                                                 chunk.rows * observation_size),
                                output.rewards.subspan(chunk.first, chunk.rows),
                                output.terminated.subspan(chunk.first, chunk.rows),
                                output.valid.subspan(chunk.first, chunk.rows)}));
  }
  return Status();
}

Result<LaneStates> RemoteEnvironment::Snapshot(std::span<const uint32_t> lanes) {
  B4MRL_RETURN_IF_ERROR(CheckLanes(lanes));
  pb::Request request;
  request.mutable_snapshot();
  ArrayLayout layout(request.mutable_arrays());
  Frame payload;
  if (!lanes.empty()) {
    const size_t offset = layout.Add("lanes", DType::kUint32, {lanes.size()});
    payload = layout.Allocate();
    CopyArray(lanes, payload, offset);
  }
  B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply,
                         connection_.Call(std::move(request), std::move(payload), NewDeadline()));
  const uint64_t count = CountOf(lanes);
  LaneStates states;
  states.lanes = count;
  B4MRL_ASSIGN_OR_RETURN(
      const TensorView snapshot,
      reply.arrays.Require("snapshot", {DType::kUint8}, {count, ArrayReader::kAny}));
  const auto bytes = snapshot.As<uint8_t>();
  states.snapshot.assign(bytes.begin(), bytes.end());
  for (const pb::Array& entry : reply.envelope.arrays()) {
    if (!IsStatePart(entry.name())) continue;
    B4MRL_ASSIGN_OR_RETURN(
        const TensorView part,
        reply.arrays.Require(entry.name(), {DType::kFloat64}, {count, ArrayReader::kAny}));
    const auto values = part.As<double>();
    states.parts[entry.name()].assign(values.begin(), values.end());
  }
  return states;
}

Result<StepOutcome> RemoteEnvironment::Restore(const LaneStates& states,
                                               std::span<const uint32_t> lanes) {
  B4MRL_RETURN_IF_ERROR(CheckLanes(lanes));
  const uint64_t count = CountOf(lanes);
  if (states.lanes != count) {
    return InvalidNumber("number of states", static_cast<double>(states.lanes),
                         fmt::format("{}, one a lane", count));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_restore();
  if (!states.snapshot.empty()) {
    request.Add("snapshot", std::span<const uint8_t>(states.snapshot),
                {count, states.snapshot.size() / count});
  } else {
    for (const auto& [name, values] : states.parts) {
      if (!IsStatePart(name)) {
        const std::string known[] = {"time", "qpos", "qvel", "qacc_warmstart"};
        return UnknownName("part of a state", name, known);
      }
      request.Add(name, std::span<const double>(values), {count, values.size() / count});
    }
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, request.Send());
  return ReadOutcome(connection_.Receive(id), /*is_step=*/false);
}

Status RemoteEnvironment::Close() {
  open_ = false;
  pb::Request request;
  request.mutable_close();
  return connection_.Call(std::move(request), Frame(), NewDeadline()).status();
}

}  // namespace b4mrl
