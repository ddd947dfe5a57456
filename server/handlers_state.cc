// Snapshot and Restore of lanes.
#include <fmt/format.h>

#include <cstring>

#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/fault_point.h"
#include "server/handlers.h"
#include "server/lane_selection.h"
#include "server/snapshot_blob.h"

namespace b4mrl {
namespace {

// Both work on all lanes as one item: they are rare, and Restore must be all or nothing.

class SnapshotJob : public RequestJob {
 public:
  explicit SnapshotJob(HandlerInput& input)
      : RequestJob(input.session, input.request->payload_case(), input.request->request_id(),
                   std::move(input.payload)) {
    items = 1;
  }
  Status Prepare(const pb::Request& request);

 protected:
  void RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;

 private:
  void WriteReply(const std::vector<NamedState>& states);
};

Status SnapshotJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(const ArrayReader arrays, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(busy_lanes_, ReadLanes(arrays, owner()));
  for (const uint32_t lane : busy_lanes_) {
    if (owner().lane(lane).busy == nullptr) continue;
    return Status(StatusCode::kBusy, fmt::format("lane {} executes another request", lane));
  }
  return Status();
}

void SnapshotJob::RunItems(uint32_t /*first*/, uint32_t /*count*/, WorkerThread& /*thread*/) {
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  if (!environment.ok()) return Fail(environment.status());
  std::vector<NamedState> states;
  for (const uint32_t lane : busy_lanes_) {
    const ConstLaneRecord record = owner().committed_record(lane);
    // A lane that was never reset has no state to show; its bytes still restore to just that.
    const bool fresh = record.header().phase == LanePhase::kFresh;
    states.push_back(fresh ? NamedState() : owner().stepper().GetNamedState(**environment, record));
  }
  WriteReply(states);
}

void SnapshotJob::WriteReply(const std::vector<NamedState>& states) {
  const size_t count = busy_lanes_.size();
  const size_t bytes = SnapshotBytes(owner().layout());
  reply_.mutable_snapshot()->set_engine_version(EngineVersion());
  ArrayLayout layout(reply_.mutable_arrays());
  const size_t snapshot = layout.Add("snapshot", DType::kUint8, {count, bytes});
  // Readable parts that all lanes have, in equal size.
  std::vector<std::pair<std::string, size_t>> parts;
  for (const auto& [name, values] : states.front()) {
    const bool everywhere = std::all_of(states.begin(), states.end(), [&](const NamedState& state) {
      const auto found = state.find(name);
      return found != state.end() && found->second.size() == values.size();
    });
    if (everywhere)
      parts.emplace_back(name, layout.Add(name, DType::kFloat64, {count, values.size()}));
  }
  if (layout.payload_bytes() > limits::kMaxPayloadBytes) {
    return Fail(Status(StatusCode::kInvalidArgument,
                       fmt::format("the snapshot has {} bytes, at most {}; name fewer lanes",
                                   layout.payload_bytes(), limits::kMaxPayloadBytes)));
  }
  reply_payload_ = layout.Allocate();
  for (size_t i = 0; i < count; ++i) {
    const std::span<std::byte> place(reply_payload_.data() + snapshot + i * bytes, bytes);
    WriteSnapshot(owner().simulator().identity_hash(), owner().committed_record(busy_lanes_[i]),
                  place);
    for (const auto& [name, offset] : parts) {
      WriteRow(reply_payload_, offset, DType::kFloat64, i, states[i].at(name));
    }
  }
}

class RestoreJob : public RequestJob {
 public:
  explicit RestoreJob(HandlerInput& input)
      : RequestJob(input.session, input.request->payload_case(), input.request->request_id(),
                   std::move(input.payload)) {
    work_kind = WorkKind::kLanes;
  }
  Status Prepare(const pb::Request& request);

 protected:
  void RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;
  void FinishReply() override;

 private:
  // 8-byte aligned memory for one lane's new record.
  using RecordBuffer = std::vector<uint64_t>;

  Status ReadNamedParts(const pb::Request& request);
  Status ComputeRecord(uint32_t position, Environment& environment, WorkerThread& thread,
                       std::span<std::byte> record) const;
  void Commit(uint32_t position, std::span<const std::byte> record);

  std::optional<ArrayReader> arrays_;
  LaneSelection selection_;
  TensorView snapshot_;  // empty: named parts
  std::map<std::string, TensorView> parts_;
};

bool IsNoPart(const std::string& name) { return name == "lanes" || name == "numbers"; }

Status RestoreJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(arrays_, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(selection_, SelectLanes(*arrays_, owner(), Operation::kRestore));
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
    if (!owner().slot(lane).condemned(AttemptKey(Operation::kRestore))) continue;
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("restoring lane {} ended its worker twice; allowed: a reset", lane));
  }
  items = selection_.execute.empty() ? 0 : 1;
  busy_lanes_ = selection_.lanes;
  return Status();
}

Status RestoreJob::ReadNamedParts(const pb::Request& request) {
  for (const pb::Array& array : request.arrays()) {
    if (IsNoPart(array.name())) continue;
    B4MRL_ASSIGN_OR_RETURN(parts_[array.name()],
                           arrays_->Require(array.name(), {DType::kFloat64},
                                            {selection_.lanes.size(), ArrayReader::kAny}));
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
  NamedState state;
  for (const auto& [name, view] : parts_) {
    const size_t size = view.shape[1];
    std::vector<double>& values = state[name];
    values.resize(size);
    CopyToDoubles(view, position * size, values);
  }
  const ScopedMark mark(thread.mark, owner().global_lane(lane), owner().lane(lane).committed + 1,
                        AttemptKey(Operation::kRestore));
  return owner().stepper().SetNamedState(environment, owner().committed_record(lane), state,
                                         LaneRecord(layout, record.data()));
}

// Everything is computed aside before the first lane is committed, so that an error restores
// nothing.
void RestoreJob::RunItems(uint32_t /*first*/, uint32_t /*count*/, WorkerThread& thread) {
  Result<Simulator::Lease> environment = owner().simulator().Borrow();
  if (!environment.ok()) return Fail(environment.status());
  const size_t bytes = owner().layout().bytes();
  std::vector<RecordBuffer> buffers(selection_.execute.size());
  for (size_t i = 0; i < buffers.size(); ++i) {
    buffers[i].resize((bytes + 7) / 8);
    const uint32_t position = selection_.execute[i];
    const std::span<std::byte> record(reinterpret_cast<std::byte*>(buffers[i].data()), bytes);
    const Status status = ComputeRecord(position, **environment, thread, record);
    if (!status.ok()) {
      return Fail(status.WithContext(fmt::format("lane {}", selection_.lanes[position])));
    }
  }
  for (size_t i = 0; i < buffers.size(); ++i) {
    Commit(selection_.execute[i], {reinterpret_cast<const std::byte*>(buffers[i].data()), bytes});
  }
}

void RestoreJob::Commit(uint32_t position, std::span<const std::byte> record) {
  LaneSlot slot = owner().slot(selection_.lanes[position]);
  std::memcpy(slot.idle_buffer().data(), record.data(), record.size());
  slot.Commit(Operation::kRestore, record.size());
}

void RestoreJob::FinishReply() {
  reply_.mutable_restore();
  const size_t count = selection_.lanes.size();
  ArrayLayout layout(reply_.mutable_arrays());
  const size_t observations = layout.Add("observations", owner().observation_dtype(),
                                         {count, owner().layout().observation_size});
  reply_payload_ = layout.Allocate();
  for (uint32_t position = 0; position < count; ++position) {
    WriteRow(reply_payload_, observations, owner().observation_dtype(), position,
             owner().committed_record(selection_.lanes[position]).observation());
  }
}

}  // namespace

Result<std::unique_ptr<RequestJob>> NewSnapshotJob(HandlerInput input) {
  auto job = std::make_unique<SnapshotJob>(input);
  B4MRL_RETURN_IF_ERROR(job->Prepare(*input.request));
  return std::unique_ptr<RequestJob>(std::move(job));
}

Result<std::unique_ptr<RequestJob>> NewRestoreJob(HandlerInput input) {
  auto job = std::make_unique<RestoreJob>(input);
  B4MRL_RETURN_IF_ERROR(job->Prepare(*input.request));
  return std::unique_ptr<RequestJob>(std::move(job));
}

}  // namespace b4mrl
