#include "server/render/painter_process.h"

#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <utility>
#include <vector>

#include "proto/base/child_program.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr const char* kProgramName = "b4mrl-render";

// The painter counts the processor time of each picture with a timer that ends the process.
bool EndedByProcessorTime(int wait_status) {
  return WIFSIGNALED(wait_status) && WTERMSIG(wait_status) == SIGPROF;
}

std::string DescribeEnd(int wait_status) {
  if (EndedByProcessorTime(wait_status)) {
    return fmt::format("it took more than {} ms of processor time", limits::kPaintProcessorMs);
  }
  if (WIFSIGNALED(wait_status)) {
    return fmt::format("its process ended with signal {} ({})", WTERMSIG(wait_status),
                       strsignal(WTERMSIG(wait_status)));
  }
  return fmt::format("its process ended with exit code {}", WEXITSTATUS(wait_status));
}

}  // namespace

PainterProcess::~PainterProcess() { End(); }

Status PainterProcess::Start() {
  const std::string program = program_.empty() ? ProgramBesideThisOne(kProgramName) : program_;
  if (access(program.c_str(), X_OK) != 0) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("this server draws no pictures: there is no {}", program));
  }
  ProgramOnSocket started;
  // The painter inherits none of the worker's listening sockets.
  if (const int error = StartOnSocket(program, {kProgramName}, &started); error != 0) {
    return IoError("start", program, error);
  }
  process_id_ = started.process_id;
  socket_ = std::move(started.socket);
  return Status();
}

bool PainterProcess::Alive() {
  if (process_id_ == 0) return false;
  int wait_status = 0;
  if (waitpid(process_id_, &wait_status, WNOHANG) != process_id_) return true;
  process_id_ = 0;
  return false;
}

int PainterProcess::End() {
  socket_ = UniqueFd();
  late_.reset();
  if (process_id_ == 0) return 0;
  kill(process_id_, SIGKILL);
  int wait_status = 0;
  while (waitpid(process_id_, &wait_status, 0) < 0 && errno == EINTR) {
  }
  process_id_ = 0;
  return wait_status;
}

int PainterProcess::EndWhileDrawing(uint64_t identity) {
  const int wait_status = End();
  if (EndedByProcessorTime(wait_status)) {
    const Clock::time_point now = Clock::now();
    std::erase_if(slow_, [&](const auto& entry) { return entry.second.forgotten <= now; });
    SlowPictures& pictures = slow_[identity];
    ++pictures.count;
    pictures.forgotten = now + std::chrono::milliseconds(limits::kPaintRefusalMs);
  }
  return wait_status;
}

Status PainterProcess::CheckNotTooSlow(uint64_t identity) const {
  const auto found = slow_.find(identity);
  if (found == slow_.end() || found->second.count < limits::kMaxSlowPictures ||
      found->second.forgotten <= Clock::now()) {
    return Status();
  }
  return Status(
      StatusCode::kLimitExceeded,
      fmt::format("{} pictures of this simulator took more processor time than allowed: "
                  "{} ms; it is not drawn for {} s",
                  found->second.count, limits::kPaintProcessorMs, limits::kPaintRefusalMs / 1000));
}

Status PainterProcess::FinishLatePicture(const Deadline& deadline) {
  if (!late_) return Status();
  const int64_t left_ms = std::min(deadline.remaining_ms(), late_->end.remaining_ms());
  const Status answered = WaitUntilReady(socket_.get(), POLLIN, Deadline::AfterMs(left_ms));
  if (!answered.ok() && !late_->end.expired()) return answered;
  const LatePicture late = *std::exchange(late_, std::nullopt);
  if (answered.ok()) {
    std::vector<std::byte> unwanted(late.bytes);
    bool refused = false;
    const Status status = ReceivePicture(socket_.get(), unwanted,
                                         Deadline::AfterMs(limits::kPaintAnswerMs), &refused);
    if (status.ok() || refused) return Status();
  }
  EndWhileDrawing(late.identity);
  return Status();
}

Status PainterProcess::Exchange(const PaintRequest& request, std::span<std::byte> picture,
                                const Deadline& deadline, bool* conversing) {
  const Deadline late_end = Deadline::AfterMs(limits::kLatePictureMs);
  const Deadline end = Deadline::AfterMs(std::min(deadline.remaining_ms(), limits::kPaintMs));
  *conversing = false;
  B4MRL_RETURN_IF_ERROR(SendPaintRequest(socket_.get(), request, end));
  const Status answered = WaitUntilReady(socket_.get(), POLLIN, end);
  if (answered.code() == StatusCode::kDeadlineExceeded && deadline.expired()) {
    // To kill the painter would have the next picture wait for another to start, and one whose
    // deadline is shorter than that would never be drawn.
    late_ = {request.identity, picture.size(), late_end};
    *conversing = true;
  }
  B4MRL_RETURN_IF_ERROR(answered);
  bool refused = false;
  const Status status =
      ReceivePicture(socket_.get(), picture, Deadline::AfterMs(limits::kPaintAnswerMs), &refused);
  *conversing = status.ok() || refused;
  return status;
}

Status PainterProcess::Paint(const PaintRequest& request, std::span<std::byte> picture,
                             const Deadline& deadline) {
  B4MRL_RETURN_IF_ERROR(FinishLatePicture(deadline));
  B4MRL_RETURN_IF_ERROR(CheckNotTooSlow(request.identity));
  // Two attempts, because an idle painter may end while the request is on its way.
  for (int attempt = 0; attempt < 2; ++attempt) {
    if (!Alive()) B4MRL_RETURN_IF_ERROR(Start());
    bool conversing = false;
    const Status status = Exchange(request, picture, deadline, &conversing);
    if (conversing) return status;
    const int wait_status = EndWhileDrawing(request.identity);
    std::string reason;
    if (status.code() == StatusCode::kDeadlineExceeded) {
      if (deadline.expired()) return status;
      reason = fmt::format("it took more than {} ms", limits::kPaintMs);
    } else if (status.code() == StatusCode::kDataLoss) {
      reason = status.message();
    } else if (WIFEXITED(wait_status) && WEXITSTATUS(wait_status) == 0) {
      continue;
    } else {
      reason = DescribeEnd(wait_status);
    }
    spdlog::warn("a picture was not drawn: {}", reason);
    return Status(StatusCode::kInternal, "drawing failed: " + reason);
  }
  return Status(StatusCode::kInternal, "drawing failed: its process ends without drawing");
}

}  // namespace b4mrl
