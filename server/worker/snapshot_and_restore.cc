// The requests Snapshot and Restore.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <deque>

#include "proto/base/limits.h"
#include "server/environments/mujoco/engine_version.h"
#include "server/scheduling/piece_timer.h"
#include "server/shared_memory/blame.h"
#include "server/worker/fault_point.h"
#include "server/worker/handlers.h"
#include "server/worker/lane_selection.h"
#include "server/worker/snapshot_blob.h"

namespace b4mrl {
namespace {

// Items are lanes. A snapshot or restore counts only as a whole, so its deadline may end it
// half-way.

class SnapshotJob : public RequestJob {
 public:
  explicit SnapshotJob(JobInput& input) : RequestJob(input) { ends_at_deadline = true; }
  Status Prepare(const pb::Request& request) override;

 protected:
  uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;
  void FinishReply() override;

 private:
  // A readable part of the state, for all lanes. The first lane decides which parts there are.
  struct Part {
    std::string name;
    size_t size;
    size_t offset;
    // True when a lane lacks this part or has it in another size; then the reply leaves it out.
    std::atomic<bool> missing{false};
  };
  Status PlanReply();
  // The readable state of a lane, which must have been reset before.
  NamedState StateOf(Environment& environment, uint32_t lane) const;
  void WriteLane(uint32_t position, Environment& environment);

  size_t snapshot_ = 0;  // offset of the array `snapshot` in the payload
  std::deque<Part> parts_;
};

Status SnapshotJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(const ArrayReader arrays, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(busy_lanes_, ReadLanes(arrays, owner()));
  for (const uint32_t lane : busy_lanes_) {
    if (owner().lane(lane).busy == nullptr) continue;
    return Status(StatusCode::kBusy, fmt::format("lane {} executes another request", lane));
  }
  items = static_cast<uint32_t>(busy_lanes_.size());
  return PlanReply();
}

NamedState SnapshotJob::StateOf(Environment& environment, uint32_t lane) const {
  return owner().stepper().GetNamedState(environment, owner().committed_record(lane));
}

Status SnapshotJob::PlanReply() {
  reply_.mutable_snapshot()->set_engine_version(EngineVersion());
  ArrayLayout layout(reply_.mutable_arrays());
  snapshot_ = layout.Add("snapshot", DType::kUint8, {items, SnapshotBytes(owner().layout())});
  // A lane that was never reset has no readable state. Restoring its bytes gives such a lane again.
  const bool any_fresh =
      std::ranges::any_of(busy_lanes_, [this](uint32_t lane) { return owner().lane(lane).fresh; });
  if (!any_fresh) {
    B4MRL_ASSIGN_OR_RETURN(const Simulator::Lease environment, owner().simulator().Borrow());
    for (const auto& [name, values] : StateOf(*environment, busy_lanes_.front())) {
      Part& part = parts_.emplace_back();
      part.name = name;
      part.size = values.size();
      part.offset = layout.Add(name, DType::kFloat64, {items, values.size()});
    }
  }
  if (layout.payload_bytes() > limits::kMaxPayloadBytes) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the snapshot has {} bytes, at most {}; name fewer lanes",
                              layout.payload_bytes(), limits::kMaxPayloadBytes));
  }
  reply_payload_ = layout.Allocate();
  return Status();
}

uint32_t SnapshotJob::RunItems(uint32_t first, uint32_t count, WorkerThread& thread) {
  const ScopedMark mark = ScopedMark::OfRequest(thread.mark, owner().index(), request_id());
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  if (!environment.ok()) {
    Fail(environment.status());
    return count;
  }
  PieceTimer timer(*cost, count);
  for (uint32_t item = first; timer.BeginItem(); ++item) WriteLane(item, **environment);
  return timer.Finish();
}

void SnapshotJob::WriteLane(uint32_t position, Environment& environment) {
  const uint32_t lane = busy_lanes_[position];
  ReachFaultPoint(FaultPoint::kBeforeSnapshot, owner().global_lane(lane), request_id());
  const size_t bytes = SnapshotBytes(owner().layout());
  WriteSnapshot(owner().simulator().identity_hash(), owner().committed_record(lane),
                {reply_payload_.data() + snapshot_ + position * bytes, bytes});
  if (parts_.empty()) return;
  const NamedState state = StateOf(environment, lane);
  for (Part& part : parts_) {
    const auto found = state.find(part.name);
    if (found != state.end() && found->second.size() == part.size) {
      WriteRow(reply_payload_, part.offset, DType::kFloat64, position, found->second);
    } else {
      part.missing.store(true, std::memory_order_relaxed);
    }
  }
}

// Lanes differ in a part's size only if a client restored them so (Highway's cars). A part that is
// left out keeps its place in the payload, filled with zeros.
void SnapshotJob::FinishReply() {
  auto* table = reply_.mutable_arrays();
  for (const Part& part : parts_) {
    if (!part.missing.load(std::memory_order_relaxed)) continue;
    std::memset(reply_payload_.data() + part.offset, 0, items * part.size * sizeof(double));
    table->erase(std::ranges::find(*table, part.name, &pb::Array::name));
  }
}

class RestoreJob : public RequestJob {
 public:
  explicit RestoreJob(JobInput& input) : RequestJob(input) {
    work_kind = WorkKind::kLanes;
    ends_at_deadline = true;
  }
  Status Prepare(const pb::Request& request) override;

 protected:
  uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;
  void FinishReply() override;

 private:
  Status ReadNamedParts(const pb::Request& request);
  Status ComputeRecord(uint32_t position, Environment& environment, WorkerThread& thread,
                       std::span<std::byte> record) const;
  void PlanReply();
  void WriteObservation(uint32_t position, ConstLaneRecord record);

  std::optional<ArrayReader> arrays_;
  LaneSelection selection_;
  size_t observations_ = 0;  // offset of the array `observations` in the payload
  TensorView snapshot_;      // empty if the request holds named parts
  std::map<std::string, TensorView> parts_;
};

bool IsNoPart(const std::string& name) { return name == "lanes" || name == "numbers"; }

Status RestoreJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(arrays_, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(selection_, SelectLanes(*arrays_, owner(), Operation::kRestore));
  is_partly_done_ = !selection_.answered.empty();
  if (arrays_->Has("snapshot")) {
    for (const pb::Array& array : request.arrays()) {
      if (IsNoPart(array.name()) || array.name() == "snapshot") continue;
      return InvalidArgument("arrays", fmt::format("a snapshot and '{}'", array.name()),
                             "a snapshot, or parts of a state");
    }
    B4MRL_ASSIGN_OR_RETURN(
        snapshot_, arrays_->Require("snapshot", {DType::kUint8},
                                    {selection_.lanes.size(), SnapshotBytes(owner().layout())}));
  } else {
    B4MRL_RETURN_IF_ERROR(ReadNamedParts(request));
  }
  for (const uint32_t position : selection_.execute) {
    const uint32_t lane = selection_.lanes[position];
    if (!OperationIsRefused(owner().slot(lane), AttemptKey(Operation::kRestore))) continue;
    return Refusal(Status(
        StatusCode::kFailedPrecondition,
        fmt::format("restoring lane {} ended its worker again and again; allowed: a reset", lane)));
  }
  items = static_cast<uint32_t>(selection_.execute.size());
  busy_lanes_ = selection_.lanes;
  PlanReply();
  return Status();
}

void RestoreJob::PlanReply() {
  reply_.mutable_restore();
  ArrayLayout layout(reply_.mutable_arrays());
  observations_ = layout.Add("observations", owner().observation_dtype(),
                             {selection_.lanes.size(), owner().layout().observation_size});
  reply_payload_ = layout.Allocate();
  for (const uint32_t position : selection_.answered) {
    WriteObservation(position, owner().committed_record(selection_.lanes[position]));
  }
}

Status RestoreJob::ReadNamedParts(const pb::Request& request) {
  // Arrays may share the payload's bytes, so its size alone does not bound a lane's numbers.
  constexpr size_t kMaxNumbers = limits::kLaneBufferBytes / sizeof(double);
  size_t numbers = 0;
  for (const pb::Array& array : request.arrays()) {
    if (IsNoPart(array.name())) continue;
    B4MRL_ASSIGN_OR_RETURN(parts_[array.name()],
                           arrays_->Require(array.name(), {DType::kFloat64},
                                            {selection_.lanes.size(), ArrayReader::kAny}));
    numbers += std::min<size_t>(parts_[array.name()].shape[1], kMaxNumbers + 1);
  }
  if (numbers > kMaxNumbers) {
    return InvalidNumber("numbers of one lane's state", numbers, fmt::format("0..{}", kMaxNumbers));
  }
  if (!parts_.empty()) return Status();
  return InvalidArgument("arrays", "neither a snapshot nor parts of a state",
                         "snapshot, or the names that Snapshot returns");
}

Status RestoreJob::ComputeRecord(uint32_t position, Environment& environment, WorkerThread& thread,
                                 std::span<std::byte> record) const {
  const LaneLayout& layout = owner().layout();
  if (parts_.empty()) {
    const size_t bytes = SnapshotBytes(layout);
    const std::span<const std::byte> source(snapshot_.data + position * bytes, bytes);
    return ReadSnapshot(owner().simulator().identity_hash(), layout, source, record);
  }
  const uint32_t lane = selection_.lanes[position];
  const uint32_t global_lane = owner().global_lane(lane);
  const uint64_t number = owner().lane(lane).committed + 1;
  const ScopedMark mark =
      ScopedMark::OfLane(thread.mark, global_lane, number, AttemptKey(Operation::kRestore));
  ReachFaultPoint(FaultPoint::kBeforeRestore, global_lane, number);
  NamedState state;
  for (const auto& [name, view] : parts_) {
    const size_t size = view.shape[1];
    std::vector<double>& values = state[name];
    values.resize(size);
    CopyToDoubles(view, position * size, values);
  }
  return owner().stepper().SetNamedState(environment, owner().committed_record(lane), state,
                                         LaneRecord(layout, record.data()));
}

// The new record of every lane waits in the lane's idle buffer until all records are there, so that
// after an error no lane is restored.
uint32_t RestoreJob::RunItems(uint32_t first, uint32_t count, WorkerThread& thread) {
  if (failed()) return count;
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  if (!environment.ok()) {
    Fail(environment.status());
    return count;
  }
  const size_t bytes = owner().layout().bytes();
  PieceTimer timer(*cost, count);
  for (uint32_t item = first; timer.BeginItem(); ++item) {
    const uint32_t position = selection_.execute[item];
    LaneSlot slot = owner().slot(selection_.lanes[position]);
    const std::span<std::byte> record = slot.idle_buffer().first(bytes);
    const Status status = ComputeRecord(position, **environment, thread, record);
    if (!status.ok()) {
      Fail(status.WithContext(fmt::format("lane {}", selection_.lanes[position])));
      return count;
    }
    slot.Seal(Operation::kRestore, bytes);
    WriteObservation(position, ConstLaneRecord(owner().layout(), record.data()));
  }
  return timer.Finish();
}

void RestoreJob::WriteObservation(uint32_t position, ConstLaneRecord record) {
  WriteRow(reply_payload_, observations_, owner().observation_dtype(), position,
           record.observation());
}

void RestoreJob::FinishReply() {
  for (const uint32_t position : selection_.execute) {
    owner().slot(selection_.lanes[position]).Publish();
  }
}

}  // namespace

std::unique_ptr<RequestJob> NewSnapshotJob(JobInput input) {
  return std::make_unique<SnapshotJob>(input);
}

std::unique_ptr<RequestJob> NewRestoreJob(JobInput input) {
  return std::make_unique<RestoreJob>(input);
}

}  // namespace b4mrl
