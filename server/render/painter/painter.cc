#include "server/render/painter/painter.h"

#include <spdlog/spdlog.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <list>
#include <memory>
#include <optional>
#include <vector>

#include "proto/base/limits.h"
#include "server/environments/canvas.h"
#include "server/log/stderr_log.h"
#include "server/render/paint_messages.h"
#include "server/render/painter/plan_renderer.h"
#include "server/render/painter/scene_renderer.h"
#include "server/simulator/simulator.h"

namespace b4mrl {
namespace {

constexpr int kNiceness = 5;                   // a third of the CPU share of a process that steps
constexpr uint64_t kMemoryBytes = 4ull << 30;  // of address space; LLVM takes 0.4 GiB of it
constexpr size_t kMaxKinds = 4;

// Draws the pictures of one simulator in one size.
class PictureKind : public Canvas {
 public:
  // kFailedPrecondition if the model is not the one that the session was opened with.
  static Result<std::unique_ptr<PictureKind>> Open(const PaintRequest& request);

  bool Fits(const PaintRequest& request) const {
    return request.identity == identity_ && request.width == width_ && request.height == height_;
  }
  Result<std::span<const std::byte>> Paint(const PaintRequest& request);

  Status DrawModel(const mjModel_& model, mjData_& data) override;
  Status DrawPlan(const PlanView& plan) override {
    return DrawPlanWithCairo(plan, width_, height_, picture_);
  }

 private:
  explicit PictureKind(const PaintRequest& request)
      : identity_(request.identity),
        width_(request.width),
        height_(request.height),
        picture_(PictureBytes(request.width, request.height)) {}

  uint64_t identity_;
  uint32_t width_, height_;
  std::shared_ptr<const Simulator> simulator_;
  std::optional<Simulator::Lease> environment_;
  std::unique_ptr<SceneRenderer> scene_;  // made for the first picture of a MuJoCo scene
  std::vector<std::byte> picture_;
};

Result<std::unique_ptr<PictureKind>> PictureKind::Open(const PaintRequest& request) {
  std::unique_ptr<PictureKind> kind(new PictureKind(request));
  B4MRL_ASSIGN_OR_RETURN(kind->simulator_, Simulator::Open(request.simulator));
  if (kind->simulator_->identity_hash() != request.identity) {
    return Status(StatusCode::kFailedPrecondition,
                  "the model's file has changed since the session was opened; open it anew");
  }
  B4MRL_ASSIGN_OR_RETURN(Simulator::Lease environment, kind->simulator_->Borrow());
  kind->environment_.emplace(std::move(environment));
  return kind;
}

Result<std::span<const std::byte>> PictureKind::Paint(const PaintRequest& request) {
  Environment& environment = **environment_;
  if (request.state.size() != environment.state_size()) {
    return InvalidNumber("size of a state", static_cast<double>(request.state.size()),
                         std::to_string(environment.state_size()));
  }
  B4MRL_RETURN_IF_ERROR(simulator_->EnterEpisode(environment, request.lane_seed, request.episode));
  environment.LoadState(request.state);
  B4MRL_RETURN_IF_ERROR(environment.Draw(*this));
  return std::span<const std::byte>(picture_);
}

Status PictureKind::DrawModel(const mjModel_& model, mjData_& data) {
  if (scene_ == nullptr) {
    B4MRL_ASSIGN_OR_RETURN(scene_, SceneRenderer::Create(model, width_, height_));
  }
  scene_->Draw(model, data, picture_);
  return Status();
}

// Keeps the PictureKinds that were drawn lately, the latest first.
class Painter {
 public:
  Result<std::span<const std::byte>> Paint(const PaintRequest& request);

 private:
  std::list<std::unique_ptr<PictureKind>> kinds_;
};

Result<std::span<const std::byte>> Painter::Paint(const PaintRequest& request) {
  const auto found = std::ranges::find_if(
      kinds_, [&](const std::unique_ptr<PictureKind>& kind) { return kind->Fits(request); });
  if (found != kinds_.end()) {
    kinds_.splice(kinds_.begin(), kinds_, found);
  } else {
    if (kinds_.size() == kMaxKinds) kinds_.pop_back();
    B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<PictureKind> kind, PictureKind::Open(request));
    kinds_.push_front(std::move(kind));
  }
  return kinds_.front()->Paint(request);
}

// Ends this process by SIGPROF once it has had so much more processor time; 0: never. Pictures are
// measured by it and not by the clock, as on a busy machine they take long through nobody's fault.
void LimitProcessorTime(int64_t milliseconds) {
  itimerval timer{};
  timer.it_value.tv_sec = milliseconds / 1000;
  timer.it_value.tv_usec = milliseconds % 1000 * 1000;
  setitimer(ITIMER_PROF, &timer, nullptr);
}

void Settle() {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  signal(SIGINT, SIG_IGN);
  signal(SIGTERM, SIG_IGN);
  signal(SIGPROF, SIG_DFL);
  // Processes that step lanes come first; beside them a picture takes longer, but is drawn.
  setpriority(PRIO_PROCESS, 0, kNiceness);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // Sanitizers reserve terabytes of addresses for their shadow memory.
  const rlimit memory{kMemoryBytes, kMemoryBytes};
  setrlimit(RLIMIT_AS, &memory);
#endif
  // Mesa rasterises on this thread, so that a picture takes one core; the user's choice counts.
  setenv("LP_NUM_THREADS", "0", 0);
}

}  // namespace

int RunPainter() {
  LogToStderr("b4mrl render: %v");
  Settle();
  Painter painter;
  while (true) {
    const auto request =
        ReceivePaintRequest(STDIN_FILENO, Deadline::AfterMs(limits::kPainterIdleMs));
    if (!request.ok()) {
      if (request.status().code() != StatusCode::kDataLoss) return 0;  // idle, or no worker left
      spdlog::error(request.status().message());
      return 1;
    }
    LimitProcessorTime(limits::kPaintProcessorMs);
    const auto picture = painter.Paint(*request);
    LimitProcessorTime(0);
    const Status sent = SendPicture(STDIN_FILENO, picture.status(),
                                    picture.ok() ? *picture : std::span<const std::byte>());
    if (!sent.ok()) return 0;
  }
}

}  // namespace b4mrl
