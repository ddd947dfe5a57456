// The requests Step and Reset.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/scheduling/piece_timer.h"
#include "server/shared_memory/blame.h"
#include "server/worker/fault_point.h"
#include "server/worker/handlers.h"
#include "server/worker/lane_selection.h"

namespace b4mrl {
namespace {

class LaneJob : public RequestJob {
 public:
  LaneJob(JobInput& input, Operation operation) : RequestJob(input), operation_(operation) {
    work_kind = WorkKind::kLanes;
  }

  // Validates the request and plans the reply.
  Status Prepare(const pb::Request& request) override;

  LedgerCounts done() const override {
    return {.steps = steps_.load(std::memory_order_relaxed),
            .episodes = episodes_.load(std::memory_order_relaxed)};
  }

 protected:
  uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;
  void FinishReply() override;

 private:
  Status ReadInputs();
  // kFailedPrecondition, or what Refusal makes of it, if the reset of a lane is refused
  // (server/shared_memory/blame.h).
  Status CheckResets() const;
  void PlanReply();
  // Adds what a step has done to `done`.
  Status Execute(uint32_t position, Environment& environment, WorkerThread& thread,
                 LedgerCounts* done);
  Status Compute(uint32_t position, Environment& environment, ConstLaneRecord before,
                 LaneRecord after, WorkerThread& thread);
  // The seed that a reset names for the lane; nothing for a step or without seeds.
  std::optional<uint64_t> SeedOf(uint32_t position) const;
  // Copies the outcome of a lane's operation from its committed record to the reply.
  void WriteOutcome(uint32_t position);

  Operation operation_;
  std::optional<ArrayReader> arrays_;
  LaneSelection selection_;
  TensorView actions_;               // of a step
  std::span<const uint64_t> seeds_;  // of a reset; empty: none
  struct {
    size_t observations, rewards, terminated, truncated, cause, digests, infos;
  } offsets_{};
  std::atomic<bool> any_ended_{false};
  std::atomic<uint64_t> steps_{0};
  std::atomic<uint64_t> episodes_{0};  // that ended in these steps
};

// In mode NEXT_STEP the step after an end simulates nothing: it begins the next episode. In mode
// DISABLED a lane may be stepped on past the end of its episode, which counts once.
void CountStep(const LaneHeader& before, const LaneHeader& after, LedgerCounts* done) {
  const bool ended = after.episode_ended != 0;
  if (ended || after.elapsed_steps > 0) ++done->steps;
  if (ended && before.phase == LanePhase::kRunning) ++done->episodes;
}

Status LaneJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(arrays_, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(selection_, SelectLanes(*arrays_, owner(), operation_));
  is_partly_done_ = !selection_.answered.empty();
  B4MRL_RETURN_IF_ERROR(ReadInputs());
  if (operation_ == Operation::kReset) B4MRL_RETURN_IF_ERROR(CheckResets());
  PlanReply();
  items = static_cast<uint32_t>(selection_.execute.size());
  // All lanes of the request stay busy until the reply has left, those that are answered from their
  // slots too, because the reply is made from their records.
  busy_lanes_ = selection_.lanes;
  for (const uint32_t position : selection_.answered) WriteOutcome(position);
  return Status();
}

// The error for actions, a row for each lane, of which a number is not finite.
Status RefuseNotFinite(const TensorView& actions, std::span<const uint32_t> lanes) {
  std::vector<double> values(actions.elements());
  CopyToDoubles(actions, 0, values);
  const auto bad = std::ranges::find_if_not(values, [](double x) { return std::isfinite(x); });
  const size_t index = bad - values.begin(), width = values.size() / lanes.size();
  return InvalidArgument(fmt::format("lane {}: actions[{}]", lanes[index / width], index % width),
                         fmt::format("{}", *bad), "finite numbers");
}

Status LaneJob::ReadInputs() {
  const size_t count = selection_.lanes.size();
  if (operation_ == Operation::kReset) {
    if (!arrays_->Has("seeds")) return Status();
    B4MRL_ASSIGN_OR_RETURN(const TensorView seeds,
                           arrays_->Require("seeds", {DType::kUint64}, {count}));
    seeds_ = seeds.As<uint64_t>();
    return Status();
  }
  const size_t action_size = owner().simulator().spec().action.size();
  B4MRL_ASSIGN_OR_RETURN(actions_, arrays_->Require("actions", {DType::kFloat32, DType::kFloat64},
                                                    {count, action_size}));
  if (!AllFinite(actions_)) return RefuseNotFinite(actions_, selection_.lanes);
  for (const uint32_t position : selection_.execute) {
    const uint32_t lane = selection_.lanes[position];
    if (!owner().lane(lane).fresh) continue;
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("lane {} must be reset before it is stepped", lane));
  }
  return Status();
}

std::optional<uint64_t> LaneJob::SeedOf(uint32_t position) const {
  if (seeds_.empty()) return std::nullopt;
  return seeds_[position];
}

Status LaneJob::CheckResets() const {
  for (const uint32_t position : selection_.execute) {
    const uint32_t lane = selection_.lanes[position];
    if (!OperationIsRefused(owner().slot(lane), AttemptKey(operation_, SeedOf(position)))) continue;
    return Refusal(Status(StatusCode::kFailedPrecondition,
                          fmt::format("the start of lane {} ended its worker again and again; "
                                      "allowed: a reset with another seed, or a restore",
                                      lane)));
  }
  return Status();
}

void LaneJob::PlanReply() {
  const size_t count = selection_.lanes.size();
  const size_t observation_size = owner().layout().observation_size;
  ArrayLayout layout(reply_.mutable_arrays());
  offsets_.observations =
      layout.Add("observations", owner().observation_dtype(), {count, observation_size});
  if (operation_ == Operation::kReset) {
    reply_.mutable_reset();
  } else {
    reply_.mutable_step();
    offsets_.rewards = layout.Add("rewards", DType::kFloat64, {count});
    offsets_.terminated = layout.Add("terminated", DType::kUint8, {count});
    offsets_.truncated = layout.Add("truncated", DType::kUint8, {count});
    offsets_.cause = layout.Add("cause", DType::kUint8, {count});
  }
  offsets_.digests = layout.Add("digests", DType::kUint64, {count});
  if (owner().reported_infos() > 0) {
    offsets_.infos = layout.Add("infos", DType::kFloat64, {count, owner().reported_infos()});
  }
  reply_payload_ = layout.Allocate();
}

uint32_t LaneJob::RunItems(uint32_t first, uint32_t count, WorkerThread& thread) {
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  // Other lanes of the request may be committed, so the status must not say "not executed".
  const auto fail = [this](const Status& status) {
    const bool is_alone = selection_.lanes.size() == 1;
    Fail(is_alone ? status : Status(StatusCode::kInternal, status.message()));
  };
  if (!environment.ok()) {
    fail(environment.status());
    return count;
  }
  LedgerCounts done;
  PieceTimer timer(*cost, count);
  for (uint32_t item = first; timer.BeginItem(); ++item) {
    const uint32_t position = selection_.execute[item];
    if (const Status status = Execute(position, **environment, thread, &done); !status.ok()) {
      fail(status.WithContext(fmt::format("lane {}", selection_.lanes[position])));
      continue;
    }
    WriteOutcome(position);
  }
  steps_.fetch_add(done.steps, std::memory_order_relaxed);
  episodes_.fetch_add(done.episodes, std::memory_order_relaxed);
  return timer.Finish();
}

Status LaneJob::Execute(uint32_t position, Environment& environment, WorkerThread& thread,
                        LedgerCounts* done) {
  const uint32_t lane = selection_.lanes[position];
  const uint32_t global_lane = owner().global_lane(lane);
  LaneSlot slot = owner().slot(lane);
  const uint64_t number = slot.committed() + 1;
  const ConstLaneRecord before = owner().committed_record(lane);
  const LaneRecord after(owner().layout(), slot.idle_buffer().data());
  const uint64_t attempt = AttemptKey(operation_, SeedOf(position));
  if (TruncationIsRefused(slot, attempt)) {
    return Status(StatusCode::kInternal, "its step and the start after it both ended the worker");
  }
  {
    const ScopedMark mark = ScopedMark::OfLane(thread.mark, global_lane, number, attempt);
    if (operation_ == Operation::kStep && OperationIsRefused(slot, attempt)) {
      B4MRL_RETURN_IF_ERROR(owner().stepper().TruncateAfterCrash(environment, before, after));
    } else {
      ReachFaultPoint(FaultPoint::kBeforeOperation, global_lane, number);
      B4MRL_RETURN_IF_ERROR(Compute(position, environment, before, after, thread));
    }
  }
  ReachFaultPoint(FaultPoint::kSlotHalfWritten, global_lane, number, after.bytes());
  slot.Commit(operation_, owner().layout().bytes());
  if (operation_ == Operation::kStep) CountStep(before.header(), after.header(), done);
  ReachFaultPoint(FaultPoint::kAfterCommit, global_lane, number);
  return Status();
}

Status LaneJob::Compute(uint32_t position, Environment& environment, ConstLaneRecord before,
                        LaneRecord after, WorkerThread& thread) {
  const LaneStepper& stepper = owner().stepper();
  if (operation_ == Operation::kReset) {
    return stepper.Reset(environment, before, SeedOf(position), after);
  }
  const size_t action_size = stepper.spec().action.size();
  thread.action.resize(action_size);
  CopyToDoubles(actions_, position * action_size, thread.action);
  const auto precision =
      actions_.dtype == DType::kFloat32 ? ActionPrecision::kFloat32 : ActionPrecision::kFloat64;
  return stepper.Step(environment, before, thread.action, after, precision);
}

void LaneJob::WriteOutcome(uint32_t position) {
  const ConstLaneRecord record = owner().committed_record(selection_.lanes[position]);
  const LaneHeader& header = record.header();
  WriteRow(reply_payload_, offsets_.observations, owner().observation_dtype(), position,
           record.observation());
  ArrayAt<uint64_t>(reply_payload_, offsets_.digests, position + 1)[position] = header.digest;
  if (owner().reported_infos() > 0) {
    WriteRow(reply_payload_, offsets_.infos, DType::kFloat64, position, record.infos());
  }
  if (operation_ == Operation::kReset) return;
  const auto byte_at = [&](size_t offset) -> uint8_t& {
    return ArrayAt<uint8_t>(reply_payload_, offset, position + 1)[position];
  };
  ArrayAt<double>(reply_payload_, offsets_.rewards, position + 1)[position] = header.reward;
  byte_at(offsets_.terminated) = header.terminated;
  byte_at(offsets_.truncated) = header.truncated;
  byte_at(offsets_.cause) = static_cast<uint8_t>(header.cause);
  if (header.episode_ended != 0) any_ended_.store(true, std::memory_order_relaxed);
}

// Episodes end rarely, so the arrays of ended episodes are added only if there are any: behind the
// other arrays, which keep their places.
void LaneJob::FinishReply() {
  if (!any_ended_.load(std::memory_order_relaxed)) return;
  std::vector<uint32_t> ended;
  for (uint32_t position = 0; position < selection_.lanes.size(); ++position) {
    const uint32_t lane = selection_.lanes[position];
    if (owner().committed_record(lane).header().episode_ended != 0) ended.push_back(position);
  }
  const DType dtype = owner().observation_dtype();
  const Frame planned = std::move(reply_payload_);
  ArrayLayout layout(reply_.mutable_arrays(), planned.size());
  const size_t lanes = layout.Add("final_lanes", DType::kUint32, {ended.size()});
  const size_t observations =
      layout.Add("final_observations", dtype, {ended.size(), owner().layout().observation_size});
  const size_t returns = layout.Add("final_returns", DType::kFloat64, {ended.size()});
  const size_t lengths = layout.Add("final_lengths", DType::kUint32, {ended.size()});
  const size_t info_count = owner().reported_infos();
  const size_t infos =
      info_count == 0 ? 0 : layout.Add("final_infos", DType::kFloat64, {ended.size(), info_count});
  reply_payload_ = layout.Allocate();
  std::memcpy(reply_payload_.data(), planned.data(), planned.size());
  for (size_t i = 0; i < ended.size(); ++i) {
    const ConstLaneRecord record = owner().committed_record(selection_.lanes[ended[i]]);
    ArrayAt<uint32_t>(reply_payload_, lanes, ended.size())[i] = ended[i];
    ArrayAt<double>(reply_payload_, returns, ended.size())[i] = record.header().final_return;
    ArrayAt<uint32_t>(reply_payload_, lengths, ended.size())[i] =
        static_cast<uint32_t>(record.header().final_length);
    WriteRow(reply_payload_, observations, dtype, i, record.final_observation());
    if (info_count == 0) continue;
    WriteRow(reply_payload_, infos, DType::kFloat64, i, record.final_infos());
  }
}

}  // namespace

std::unique_ptr<RequestJob> NewStepJob(JobInput input) {
  return std::make_unique<LaneJob>(input, Operation::kStep);
}

std::unique_ptr<RequestJob> NewResetJob(JobInput input) {
  return std::make_unique<LaneJob>(input, Operation::kReset);
}

}  // namespace b4mrl
