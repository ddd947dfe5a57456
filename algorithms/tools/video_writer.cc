#include "algorithms/tools/video_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <utility>
#include <vector>

#include "proto/base/clock.h"

extern char** environ;

namespace b4mrl {
namespace {

constexpr int64_t kFrameMs = 30'000;    // for ffmpeg to take one picture
constexpr int64_t kFinishMs = 120'000;  // to encode what it holds back

std::vector<std::string> CommandLine(const std::string& path, uint32_t width, uint32_t height,
                                     double frames_per_second) {
  const std::string rate = fmt::format("{:.6f}", frames_per_second);
  std::vector<std::string> words = {"ffmpeg", "-hide_banner", "-loglevel", "error", "-y"};
  const auto add = [&words](const char* option, std::string value) {
    words.emplace_back(option);
    words.push_back(std::move(value));
  };
  add("-f", "rawvideo");
  add("-pixel_format", "rgb24");
  add("-video_size", fmt::format("{}x{}", width, height));
  add("-framerate", rate);
  add("-i", "pipe:0");
  add("-r", rate);  // or ffmpeg takes 125 for a slip of 120
  add("-pix_fmt", "yuv420p");
  words.push_back("file:" + path);  // so that no path is read as an option or a protocol
  return words;
}

// The exit code; -1 when a signal ended it or it had to be ended.
int WaitForExit(pid_t id, const Deadline& deadline) {
  const UniqueFd handle(static_cast<int>(syscall(SYS_pidfd_open, id, 0)));
  pollfd waiting{handle.get(), POLLIN, 0};
  while (poll(&waiting, 1, static_cast<int>(deadline.remaining_ms())) <= 0) {
    if (deadline.expired()) {
      kill(id, SIGKILL);
      break;
    }
  }
  int status = 0;
  while (waitpid(id, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace

VideoWriter::VideoWriter(std::string path, pid_t process_id, UniqueFd pipe)
    : path_(std::move(path)), process_id_(process_id), pipe_(std::move(pipe)) {}

VideoWriter::VideoWriter(VideoWriter&& other) noexcept
    : path_(std::move(other.path_)),
      process_id_(std::exchange(other.process_id_, 0)),
      pipe_(std::move(other.pipe_)) {}

VideoWriter::~VideoWriter() {
  if (process_id_ == 0) return;
  kill(process_id_, SIGKILL);
  WaitForExit(process_id_, Deadline::AfterMs(kFrameMs));
  unlink(path_.c_str());
}

Result<VideoWriter> VideoWriter::Open(const std::string& path, uint32_t width, uint32_t height,
                                      double frames_per_second) {
  // A socket rather than a pipe, because writing to it can be told not to raise SIGPIPE.
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    return IoError("make a pipe for", "ffmpeg", errno);
  }
  UniqueFd ours(ends[0]);
  const UniqueFd theirs(ends[1]);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, theirs.get(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  std::vector<std::string> words = CommandLine(path, width, height, frames_per_second);
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_t process_id = 0;
  const int error = posix_spawnp(&process_id, "ffmpeg", &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) {
    return Status(StatusCode::kUnsupported,
                  "a video needs the program ffmpeg (Debian: apt install ffmpeg)");
  }
  if (error != 0) return IoError("start", "ffmpeg", error);
  return VideoWriter(path, process_id, std::move(ours));
}

Status VideoWriter::Failed() {
  return Status(StatusCode::kIoError, fmt::format("ffmpeg cannot write {}", path_));
}

Status VideoWriter::Write(std::span<const uint8_t> frame) {
  const Deadline deadline = Deadline::AfterMs(kFrameMs);
  while (!frame.empty()) {
    const ssize_t sent = send(pipe_.get(), frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent > 0) {
      frame = frame.subspan(static_cast<size_t>(sent));
      continue;
    }
    if (errno != EAGAIN && errno != EINTR) return Failed();
    pollfd waiting{pipe_.get(), POLLOUT, 0};
    poll(&waiting, 1, static_cast<int>(deadline.remaining_ms()));
    if (deadline.expired()) return Failed();
  }
  return Status();
}

Status VideoWriter::Finish() {
  pipe_ = UniqueFd();  // the end of its input
  const int exit_code = WaitForExit(process_id_, Deadline::AfterMs(kFinishMs));
  process_id_ = 0;
  if (exit_code == 0) return Status();
  unlink(path_.c_str());
  return Failed();
}

}  // namespace b4mrl
