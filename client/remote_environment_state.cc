// Reading, writing and drawing the states of lanes.
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "client/numbered_request.h"
#include "client/remote_environment.h"

namespace b4mrl {
namespace {

constexpr std::string_view kSnapshot = "snapshot";

// Elements of one lane, if `elements` is the number of elements of `lanes` lanes.
Result<uint64_t> SizePerLane(std::string_view name, uint64_t elements, uint64_t lanes) {
  if (elements % lanes == 0) return elements / lanes;
  return InvalidNumber(fmt::format("length of {}", name), static_cast<double>(elements),
                       fmt::format("a multiple of the {} lanes", lanes));
}

// The payload of a request about `lanes`; empty if `lanes` is empty, which means all lanes.
Result<Frame> AddLanes(std::span<const uint32_t> lanes, pb::Request& request) {
  if (lanes.empty()) return Frame();
  ArrayLayout layout(request.mutable_arrays());
  const size_t offset = layout.Add("lanes", DType::kUint32, {lanes.size()});
  B4MRL_ASSIGN_OR_RETURN(Frame payload, AllocatePayload(layout));
  std::ranges::copy(lanes, ArrayAt<uint32_t>(payload, offset, lanes.size()).begin());
  return payload;
}

}  // namespace

Result<LaneStates> RemoteEnvironment::Snapshot(std::span<const uint32_t> lanes) {
  B4MRL_RETURN_IF_ERROR(numbers_.CheckRange(lanes));
  pb::Request request;
  request.mutable_snapshot();
  B4MRL_ASSIGN_OR_RETURN(Frame payload, AddLanes(lanes, request));
  B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply,
                         connection_->Call(std::move(request), std::move(payload), NewDeadline()));
  LaneStates states;
  states.lanes = numbers_.CountOf(lanes);
  for (const pb::Array& entry : reply.envelope.arrays()) {
    const bool exact = entry.name() == kSnapshot;
    B4MRL_ASSIGN_OR_RETURN(const TensorView view,
                           reply.Require(entry.name(), {exact ? DType::kUint8 : DType::kFloat64},
                                         {states.lanes, ArrayReader::kAny}));
    if (exact) {
      const std::span<const uint8_t> bytes = view.As<uint8_t>();
      states.snapshot.assign(bytes.begin(), bytes.end());
    } else {
      const std::span<const double> values = view.As<double>();
      states.parts[entry.name()].assign(values.begin(), values.end());
    }
  }
  return states;
}

Result<Pictures> RemoteEnvironment::Render(std::span<const uint32_t> lanes, uint32_t width,
                                           uint32_t height) {
  B4MRL_RETURN_IF_ERROR(numbers_.CheckRange(lanes));
  pb::Request request;
  request.mutable_render()->set_width(width);
  request.mutable_render()->set_height(height);
  B4MRL_ASSIGN_OR_RETURN(Frame payload, AddLanes(lanes, request));
  Pictures pictures;
  B4MRL_ASSIGN_OR_RETURN(pictures.reply,
                         connection_->Call(std::move(request), std::move(payload), NewDeadline()));
  pictures.width = width == 0 ? spec_.picture_width : width;
  pictures.height = height == 0 ? spec_.picture_height : height;
  B4MRL_ASSIGN_OR_RETURN(pictures.frames, pictures.reply.Column<uint8_t>(
                                              "frames", {numbers_.CountOf(lanes), pictures.height,
                                                         pictures.width, uint64_t{3}}));
  return pictures;
}

Result<StepOutcome> RemoteEnvironment::Restore(const LaneStates& states,
                                               std::span<const uint32_t> lanes) {
  B4MRL_RETURN_IF_ERROR(numbers_.CheckRange(lanes));
  const uint64_t count = numbers_.CountOf(lanes);
  if (states.lanes != count) {
    return InvalidNumber("number of states", static_cast<double>(states.lanes),
                         fmt::format("{}, one a lane", count));
  }
  NumberedRequest request(*this, lanes);
  request.request().mutable_restore();
  if (!states.snapshot.empty()) {
    B4MRL_ASSIGN_OR_RETURN(const uint64_t bytes,
                           SizePerLane(kSnapshot, states.snapshot.size(), count));
    request.Add(kSnapshot, std::span<const uint8_t>(states.snapshot), {count, bytes});
  } else {
    for (const auto& [name, values] : states.parts) {
      B4MRL_ASSIGN_OR_RETURN(const uint64_t size, SizePerLane(name, values.size(), count));
      request.Add(name, std::span<const double>(values), {count, size});
    }
  }
  B4MRL_ASSIGN_OR_RETURN(const uint64_t id, request.Send());
  return ReceiveNumbered(id, /*is_step=*/false);
}

}  // namespace b4mrl
