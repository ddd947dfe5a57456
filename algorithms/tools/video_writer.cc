#include "algorithms/tools/video_writer.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <utility>
#include <vector>

#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

constexpr int64_t kFrameMs = 30'000;    // for ffmpeg to take one picture
constexpr int64_t kFinishMs = 120'000;  // for ffmpeg to encode the pictures that it still holds

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
  add("-r", rate);  // otherwise ffmpeg changes 125 pictures per second to 120
  add("-pix_fmt", "yuv420p");
  words.push_back("file:" + path);  // so that no path is read as an option or a protocol
  return words;
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
  ProgramOnSocket ffmpeg;
  const int error =
      StartOnSocket("ffmpeg", CommandLine(path, width, height, frames_per_second), &ffmpeg);
  if (error == ENOENT) {
    return Status(StatusCode::kUnsupported,
                  "a video needs the program ffmpeg (Debian: apt install ffmpeg)");
  }
  if (error != 0) return IoError("start", "ffmpeg", error);
  return VideoWriter(path, ffmpeg.process_id, std::move(ffmpeg.socket));
}

Status VideoWriter::Failed() {
  return Status(StatusCode::kIoError, fmt::format("ffmpeg cannot write {}", path_));
}

Status VideoWriter::Write(std::span<const uint8_t> frame) {
  const Status sent = SendAll(pipe_.get(), std::as_bytes(frame), Deadline::AfterMs(kFrameMs));
  return sent.ok() ? sent : Failed();
}

Status VideoWriter::Finish() {
  pipe_ = UniqueFd();  // ends ffmpeg's input
  const int wait_status = WaitForExit(process_id_, Deadline::AfterMs(kFinishMs));
  process_id_ = 0;
  if (wait_status == 0) return Status();  // exit code 0, no signal
  unlink(path_.c_str());
  return Failed();
}

}  // namespace b4mrl
