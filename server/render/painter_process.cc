#include "server/render/painter_process.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include "proto/base/child_program.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr const char* kProgramName = "b4mrl-render";

std::string DescribeEnd(int wait_status) {
  if (WIFSIGNALED(wait_status)) {
    return fmt::format("signal {} ({})", WTERMSIG(wait_status), strsignal(WTERMSIG(wait_status)));
  }
  return fmt::format("exit code {}", WEXITSTATUS(wait_status));
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
  if (process_id_ == 0) return 0;
  kill(process_id_, SIGKILL);
  int wait_status = 0;
  while (waitpid(process_id_, &wait_status, 0) < 0 && errno == EINTR) {
  }
  process_id_ = 0;
  return wait_status;
}

Status PainterProcess::Exchange(const PaintRequest& request, std::span<std::byte> picture,
                                bool* conversing) {
  const Deadline deadline = Deadline::AfterMs(limits::kPaintMs);
  *conversing = false;
  B4MRL_RETURN_IF_ERROR(SendPaintRequest(socket_.get(), request, deadline));
  bool refused = false;
  const Status status = ReceivePicture(socket_.get(), picture, deadline, &refused);
  *conversing = status.ok() || refused;
  return status;
}

Status PainterProcess::Paint(const PaintRequest& request, std::span<std::byte> picture) {
  // Two attempts, because an idle painter may end while the request is on its way.
  for (int attempt = 0; attempt < 2; ++attempt) {
    if (!Alive()) B4MRL_RETURN_IF_ERROR(Start());
    bool conversing = false;
    const Status status = Exchange(request, picture, &conversing);
    if (conversing) return status;
    const int wait_status = End();
    std::string reason;
    if (status.code() == StatusCode::kDeadlineExceeded) {
      reason = fmt::format("it took more than {} ms", limits::kPaintMs);
    } else if (status.code() == StatusCode::kDataLoss) {
      reason = status.message();
    } else if (WIFEXITED(wait_status) && WEXITSTATUS(wait_status) == 0) {
      continue;
    } else {
      reason = fmt::format("its process ended with {}", DescribeEnd(wait_status));
    }
    spdlog::warn("a picture was not drawn: {}", reason);
    return Status(StatusCode::kInternal, "drawing failed: " + reason);
  }
  return Status(StatusCode::kInternal, "drawing failed: its process ends without drawing");
}

}  // namespace b4mrl
