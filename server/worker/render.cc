// The request Render: pictures of lanes. It changes no lane and keeps none busy.
#include <fmt/format.h>

#include "proto/base/limits.h"
#include "server/process/memory_shares.h"
#include "server/render/painter_process.h"
#include "server/worker/handlers.h"
#include "server/worker/lane_selection.h"

namespace b4mrl {
namespace {

// The states are copied when the request arrives: the committed record of a lane cannot change
// while the socket's thread looks at it, so a picture shows the lane between two operations, even
// if the next one is under way.
class RenderJob : public RequestJob {
 public:
  explicit RenderJob(JobInput& input) : RequestJob(input) {
    // The cost of pictures is never observed, so each is a piece of its own, and the deadline can
    // end those that are left.
    ends_at_deadline = true;
  }
  ~RenderJob() override { owner().pictures->GiveBack(held_share_); }
  Status Prepare(const pb::Request& request) override;
  bool waits_for_painter() const override { return true; }

 protected:
  uint32_t RunItems(uint32_t first, uint32_t count, WorkerThread& thread) override;

 private:
  void Paint(uint32_t first, uint32_t count, PainterProcess& painter);
  Status ChooseSize(const pb::RenderRequest& request);
  Status TooLate() const;
  Status TakeShare(size_t bytes);
  void CopyLanes(const std::vector<uint32_t>& lanes);

  // A lane's state and the episode that it belongs to.
  struct Scene {
    uint64_t lane_seed, episode;
    std::vector<double> state;
  };
  PaintRequest picture_;       // with the state of the item that is being painted
  std::vector<Scene> scenes_;  // one for each item
  size_t held_share_ = 0;      // bytes of the sessions' common share of pictures
  size_t offset_ = 0;
  uint32_t painted_ = 0;  // how many items are painted; one thread takes them in any order
};

Status CheckSide(std::string_view name, uint32_t side) {
  if (side >= limits::kMinPictureSide && side <= limits::kMaxPictureSide) return Status();
  return InvalidNumber(
      name, side,
      fmt::format("0 (default) or {}..{}", limits::kMinPictureSide, limits::kMaxPictureSide));
}

Status RenderJob::ChooseSize(const pb::RenderRequest& request) {
  const EnvironmentSpec& spec = owner().simulator().spec();
  picture_.width = request.width() == 0 ? spec.picture_width : request.width();
  picture_.height = request.height() == 0 ? spec.picture_height : request.height();
  B4MRL_RETURN_IF_ERROR(CheckSide("width", picture_.width));
  return CheckSide("height", picture_.height);
}

// Pictures that wait hold only their states, but the painter's thread begins with all requests in
// turn.
Status RenderJob::TakeShare(size_t bytes) {
  SharedBytes& pictures = *owner().pictures;
  if (!pictures.Take(bytes)) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("the pictures under way in the worker and the states that they show "
                              "would have {} bytes, at most {} (by `b4mrl serve --memory`)",
                              pictures.held() + bytes, pictures.share()));
  }
  held_share_ = bytes;
  return Status();
}

void RenderJob::CopyLanes(const std::vector<uint32_t>& lanes) {
  for (const uint32_t lane : lanes) {
    const ConstLaneRecord record = owner().committed_record(lane);
    const std::span<const double> state = record.state();
    scenes_.push_back({record.header().lane_seed, record.header().episode,
                       std::vector<double>(state.begin(), state.end())});
  }
}

Status RenderJob::Prepare(const pb::Request& request) {
  B4MRL_ASSIGN_OR_RETURN(const ArrayReader arrays, ArrayReader::Parse(request.arrays(), payload()));
  B4MRL_ASSIGN_OR_RETURN(const std::vector<uint32_t> lanes, ReadLanes(arrays, owner()));
  B4MRL_RETURN_IF_ERROR(ChooseSize(request.render()));
  const size_t bytes = lanes.size() * PictureBytes(picture_.width, picture_.height);
  if (bytes > limits::kMaxPayloadBytes) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} pictures of {} x {} have {} bytes, at most {}; name fewer lanes",
                              lanes.size(), picture_.width, picture_.height, bytes,
                              limits::kMaxPayloadBytes));
  }
  for (const uint32_t lane : lanes) {
    if (owner().committed_record(lane).header().phase == LanePhase::kFresh) {
      return Status(StatusCode::kFailedPrecondition,
                    fmt::format("lane {} has not been reset: there is nothing to see", lane));
    }
  }
  const size_t state_bytes = owner().layout().state_size * sizeof(double);
  B4MRL_RETURN_IF_ERROR(TakeShare(bytes + lanes.size() * state_bytes));
  CopyLanes(lanes);
  picture_.simulator = owner().simulator_request();
  picture_.identity = owner().simulator().identity_hash();
  items = static_cast<uint32_t>(lanes.size());
  reply_.mutable_render();
  return Status();
}

Status RenderJob::TooLate() const {
  return Status(StatusCode::kDeadlineExceeded,
                fmt::format("the deadline passed after {} of {} pictures", painted_, items));
}

uint32_t RenderJob::RunItems(uint32_t first, uint32_t count, WorkerThread& thread) {
  Paint(first, count, *thread.painter);
  return count;
}

void RenderJob::Paint(uint32_t first, uint32_t count, PainterProcess& painter) {
  if (failed()) return;
  const size_t bytes = PictureBytes(picture_.width, picture_.height);
  if (painted_ == 0) {
    // Allocated with the first picture, so that waiting requests hold no memory for their replies.
    ArrayLayout layout(reply_.mutable_arrays());
    offset_ = layout.Add("frames", DType::kUint8, {items, picture_.height, picture_.width, 3});
    reply_payload_ = layout.Allocate();
  }
  for (uint32_t item = first; item < first + count && !failed(); ++item) {
    if (deadline.expired()) return Fail(TooLate());
    picture_.lane_seed = scenes_[item].lane_seed;
    picture_.episode = scenes_[item].episode;
    picture_.state = scenes_[item].state;
    const std::span<std::byte> place(reply_payload_.data() + offset_ + item * bytes, bytes);
    const Status status = painter.Paint(picture_, place, deadline);
    if (status.code() == StatusCode::kDeadlineExceeded) return Fail(TooLate());
    if (!status.ok()) return Fail(status);
    ++painted_;
  }
}

}  // namespace

std::unique_ptr<RequestJob> NewRenderJob(JobInput input) {
  return std::make_unique<RenderJob>(input);
}

}  // namespace b4mrl
