// Queries of the simulator, split into requests of which several are in flight.
#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "client/remote_environment.h"

namespace b4mrl {
namespace {

// Requests of one Query call that are under way at once: enough to keep every thread of a worker
// busy while one answer is copied out.
constexpr size_t kQueryRequestsInFlight = 6;
// Of one such request: few enough for a worker on a small machine to hold them all with their
// answers, and for a slow simulator to answer them within the deadline.
constexpr size_t kRowsAtOnce = 1024;
static_assert(kRowsAtOnce <= limits::kMaxQueryRows);

template <typename Scalar>
Status CheckOutput(const QueryResults<Scalar>& output, size_t observation_size) {
  const size_t rows = output.rewards.size();
  if (output.terminated.size() != rows || output.valid.size() != rows ||
      output.next_observations.size() != rows * observation_size) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the buffers of a query differ in their rows: rewards {}, terminated "
                              "{}, valid {}, next_observations {} / {}",
                              rows, output.terminated.size(), output.valid.size(),
                              output.next_observations.size(), observation_size));
  }
  return Status();
}

template <typename Scalar>
QueryResults<Scalar> Rows(const QueryResults<Scalar>& output, size_t first, size_t count,
                          size_t observation_size) {
  return {output.next_observations.subspan(first * observation_size, count * observation_size),
          output.rewards.subspan(first, count), output.terminated.subspan(first, count),
          output.valid.subspan(first, count)};
}

template <typename Scalar>
void CopyInto(const TensorView& from, std::span<Scalar> to) {
  const auto convert = [](auto x) { return static_cast<Scalar>(x); };
  if (from.dtype == DType::kFloat32) {
    std::ranges::transform(from.As<float>(), to.begin(), convert);
  } else {
    std::ranges::transform(from.As<double>(), to.begin(), convert);
  }
}

}  // namespace

template <typename Scalar>
Result<uint64_t> RemoteEnvironment::SendRows(std::span<const Scalar> observations,
                                             std::span<const Scalar> actions, uint64_t seed,
                                             uint64_t draw, uint64_t first_row) {
  const uint64_t rows = actions.size() / spec_.action.size();
  if (actions.size() != rows * spec_.action.size() ||
      observations.size() != rows * spec_.observation.size()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} observation values and {} action values, allowed: rows x {} and "
                              "rows x {}",
                              observations.size(), actions.size(), spec_.observation.size(),
                              spec_.action.size()));
  }
  pb::Request request;
  pb::QueryRequest* query = request.mutable_query();
  query->set_seed(seed);
  query->set_draw(draw);
  query->set_first_row(first_row);
  ArrayLayout layout(request.mutable_arrays());
  const size_t observations_offset =
      layout.Add("observations", DTypeOf<Scalar>(), {rows, spec_.observation.size()});
  const size_t actions_offset =
      layout.Add("actions", DTypeOf<Scalar>(), {rows, spec_.action.size()});
  B4MRL_ASSIGN_OR_RETURN(Frame payload, AllocatePayload(layout));
  std::ranges::copy(observations,
                    ArrayAt<Scalar>(payload, observations_offset, observations.size()).begin());
  std::ranges::copy(actions, ArrayAt<Scalar>(payload, actions_offset, actions.size()).begin());
  Result<uint64_t> id = connection_->Send(std::move(request), std::move(payload), NewDeadline());
  if (id.ok()) query_rows_[*id] = rows;
  return id;
}

template <typename Scalar>
Status RemoteEnvironment::ReceiveRows(uint64_t id, const QueryResults<Scalar>& output) {
  if (FindUnderWay(id) != under_way_.end()) {
    return InvalidArgument("id", std::to_string(id), "that of a query, not of a step");
  }
  B4MRL_RETURN_IF_ERROR(CheckOutput(output, spec_.observation.size()));
  const uint64_t rows = output.rewards.size();
  const auto sent = query_rows_.find(id);
  if (sent != query_rows_.end() && sent->second != rows) {
    return InvalidArgument("rows of the results", std::to_string(rows),
                           fmt::format("{}, as the query has", sent->second));
  }
  query_rows_.erase(id);
  B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply, connection_->Receive(id));
  B4MRL_ASSIGN_OR_RETURN(const TensorView next,
                         reply.Require("next_observations", {DType::kFloat32, DType::kFloat64},
                                       {rows, spec_.observation.size()}));
  B4MRL_ASSIGN_OR_RETURN(const auto rewards, reply.Column<double>("rewards", {rows}));
  B4MRL_ASSIGN_OR_RETURN(const auto terminated, reply.Column<uint8_t>("terminated", {rows}));
  B4MRL_ASSIGN_OR_RETURN(const auto valid, reply.Column<uint8_t>("valid", {rows}));
  CopyInto(next, output.next_observations);
  std::ranges::copy(rewards, output.rewards.begin());
  std::ranges::copy(terminated, output.terminated.begin());
  std::ranges::copy(valid, output.valid.begin());
  return Status();
}

template <typename Scalar>
Status RemoteEnvironment::QueryRows(std::span<const Scalar> observations,
                                    std::span<const Scalar> actions,
                                    const QueryResults<Scalar>& output, uint64_t seed,
                                    std::optional<uint64_t> draw, uint64_t first_row) {
  struct Chunk {
    uint64_t id;
    size_t first;
    size_t rows;
  };
  const size_t rows = output.rewards.size();
  const size_t observation_size = spec_.observation.size();
  const size_t action_size = spec_.action.size();
  B4MRL_RETURN_IF_ERROR(CheckOutput(output, observation_size));
  if (observations.size() != rows * observation_size || actions.size() != rows * action_size) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} observation values and {} action values, allowed: {} x {} and "
                              "{} x {}",
                              observations.size(), actions.size(), rows, observation_size, rows,
                              action_size));
  }
  const uint64_t draw_of_call = draw ? *draw : next_draw_++;
  std::deque<Chunk> chunks;
  Status status;
  for (size_t next = 0; status.ok() && (next < rows || !chunks.empty());) {
    if (next < rows && chunks.size() < kQueryRequestsInFlight) {
      const size_t count = std::min(rows - next, kRowsAtOnce);
      const Result<uint64_t> id =
          SendRows(observations.subspan(next * observation_size, count * observation_size),
                   actions.subspan(next * action_size, count * action_size), seed, draw_of_call,
                   first_row + next);
      if (id.ok()) chunks.push_back({*id, next, count});
      status = id.status();
      next += count;
    } else {
      const Chunk chunk = chunks.front();
      chunks.pop_front();
      status = ReceiveRows(chunk.id, Rows(output, chunk.first, chunk.rows, observation_size));
      if (!status.ok()) connection_->Abandon(chunk.id);
    }
  }
  for (const Chunk& chunk : chunks) {
    connection_->Abandon(chunk.id);
    query_rows_.erase(chunk.id);
  }
  return status;
}

Status RemoteEnvironment::Query(std::span<const float> observations, std::span<const float> actions,
                                const QueryResults<float>& output, uint64_t seed,
                                std::optional<uint64_t> draw, uint64_t first_row) {
  return QueryRows(observations, actions, output, seed, draw, first_row);
}
Status RemoteEnvironment::Query(std::span<const double> observations,
                                std::span<const double> actions, const QueryResults<double>& output,
                                uint64_t seed, std::optional<uint64_t> draw, uint64_t first_row) {
  return QueryRows(observations, actions, output, seed, draw, first_row);
}

Result<uint64_t> RemoteEnvironment::SendQuery(std::span<const float> observations,
                                              std::span<const float> actions, uint64_t seed,
                                              uint64_t draw, uint64_t first_row) {
  return SendRows(observations, actions, seed, draw, first_row);
}
Result<uint64_t> RemoteEnvironment::SendQuery(std::span<const double> observations,
                                              std::span<const double> actions, uint64_t seed,
                                              uint64_t draw, uint64_t first_row) {
  return SendRows(observations, actions, seed, draw, first_row);
}

Status RemoteEnvironment::ReceiveQuery(uint64_t id, const QueryResults<float>& output) {
  return ReceiveRows(id, output);
}
Status RemoteEnvironment::ReceiveQuery(uint64_t id, const QueryResults<double>& output) {
  return ReceiveRows(id, output);
}

}  // namespace b4mrl
