// The request Query: the simulator's transition T_sim from arbitrary observations and actions. It
// changes no lane.
#include <fmt/format.h>

#include "proto/base/limits.h"
#include "server/scheduling/piece_timer.h"
#include "server/shared_memory/blame.h"
#include "server/worker/fault_point.h"
#include "server/worker/handlers.h"
#include "server/worker/lane_selection.h"
#include "server/worker/throughput_slice.h"

namespace b4mrl {
namespace {

class QueryJob : public RequestJob {
 public:
  explicit QueryJob(JobInput& input)
      : RequestJob(input),
        first_row_{input.request->query().seed(), input.request->query().draw(),
                   input.request->query().first_row()} {
    work_kind = WorkKind::kQuery;
    ends_at_deadline = true;
  }

  Status Prepare(const pb::Request& request) override;
  LedgerCounts done() const override { return {.query_rows = failed() ? 0 : items}; }

 protected:
  uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;

 private:
  void PlanReply();
  void RunRow(uint32_t row, Environment& environment, WorkerThread& thread,
              std::span<double> next_observation);

  QueryRow first_row_;
  std::optional<ArrayReader> arrays_;
  TensorView observations_;
  TensorView actions_;
  struct {
    size_t next_observations, rewards, terminated, valid;
  } offsets_{};
};

Status QueryJob::Prepare(const pb::Request& request) {
  B4MRL_RETURN_IF_ERROR(owner().simulator().CheckQueryable());
  const EnvironmentSpec& spec = owner().simulator().spec();
  B4MRL_ASSIGN_OR_RETURN(arrays_, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(observations_,
                         arrays_->Require("observations", {DType::kFloat32, DType::kFloat64},
                                          {ArrayReader::kAny, spec.observation.size()}));
  const uint64_t rows = observations_.rows();
  if (rows == 0 || rows > limits::kMaxQueryRows) {
    return InvalidNumber("rows of observations", static_cast<double>(rows),
                         fmt::format("1..{}", limits::kMaxQueryRows));
  }
  B4MRL_ASSIGN_OR_RETURN(actions_, arrays_->Require("actions", {DType::kFloat32, DType::kFloat64},
                                                    {rows, spec.action.size()}));
  items = static_cast<uint32_t>(rows);
  PlanReply();
  return Status();
}

void QueryJob::PlanReply() {
  const size_t rows = items;
  ArrayLayout layout(reply_.mutable_arrays());
  reply_.mutable_query();
  offsets_.next_observations = layout.Add("next_observations", owner().observation_dtype(),
                                          {rows, owner().simulator().spec().observation.size()});
  offsets_.rewards = layout.Add("rewards", DType::kFloat64, {rows});
  offsets_.terminated = layout.Add("terminated", DType::kUint8, {rows});
  offsets_.valid = layout.Add("valid", DType::kUint8, {rows});
  reply_payload_ = layout.Allocate();
}

uint32_t QueryJob::RunItems(uint32_t first, uint32_t count, WorkerThread& thread) {
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  if (!environment.ok()) {
    Fail(environment.status());
    return count;
  }
  const EnvironmentSpec& spec = owner().simulator().spec();
  thread.observation.resize(2 * spec.observation.size());
  thread.action.resize(spec.action.size());
  const std::span<double> next(thread.observation.data() + spec.observation.size(),
                               spec.observation.size());
  const ScopedThroughputSlice lanes_go_first;
  PieceTimer timer(*cost, count);
  for (uint32_t row = first; timer.BeginItem(); ++row) {
    const ScopedMark mark = ScopedMark::OfRequest(thread.mark, owner().index(), request_id());
    ReachFaultPoint(FaultPoint::kBeforeQueryRow, row, request_id());
    RunRow(row, **environment, thread, next);
  }
  return timer.Finish();
}

void QueryJob::RunRow(uint32_t row, Environment& environment, WorkerThread& thread,
                      std::span<double> next_observation) {
  const std::span<double> observation(thread.observation.data(), next_observation.size());
  CopyToDoubles(observations_, row * observation.size(), observation);
  CopyToDoubles(actions_, row * thread.action.size(), thread.action);
  const QueryRow noise{first_row_.seed, first_row_.draw, first_row_.row + row};
  const QueryResult result =
      owner().simulator().Query(environment, noise, observation, thread.action, next_observation);
  WriteRow(reply_payload_, offsets_.next_observations, owner().observation_dtype(), row,
           next_observation);
  ArrayAt<double>(reply_payload_, offsets_.rewards, row + 1)[row] = result.reward;
  ArrayAt<uint8_t>(reply_payload_, offsets_.terminated, row + 1)[row] = result.terminated;
  ArrayAt<uint8_t>(reply_payload_, offsets_.valid, row + 1)[row] = result.valid;
}

}  // namespace

std::unique_ptr<RequestJob> NewQueryJob(JobInput input) {
  return std::make_unique<QueryJob>(input);
}

}  // namespace b4mrl
