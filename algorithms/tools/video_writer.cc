#include "algorithms/tools/video_writer.h"

#include <fmt/format.h>
#include <stdlib.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

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

VideoWriter::VideoWriter(std::string path, std::string folder)
    : path_(std::move(path)), folder_(std::move(folder)) {}

VideoWriter::VideoWriter(VideoWriter&& other) noexcept
    : path_(std::move(other.path_)),
      folder_(std::exchange(other.folder_, "")),
      process_id_(std::exchange(other.process_id_, 0)),
      pipe_(std::move(other.pipe_)) {}

VideoWriter::~VideoWriter() {
  if (process_id_ != 0) {
    kill(process_id_, SIGKILL);
    WaitForExit(process_id_, Deadline::AfterMs(kFrameMs));
  }
  std::error_code error;
  if (!folder_.empty()) fs::remove_all(folder_, error);
}

std::string VideoWriter::FilmPath() const {
  return fs::path(folder_) / fs::path(path_).filename();  // with the ending, for ffmpeg
}

Result<VideoWriter> VideoWriter::Open(const std::string& path, uint32_t width, uint32_t height,
                                      double frames_per_second) {
  std::string folder = FolderOf(path) + "/.b4mrl-film-XXXXXX";
  if (mkdtemp(folder.data()) == nullptr) return IoError("write beside", path, errno);
  VideoWriter writer(path, std::move(folder));
  ProgramOnSocket ffmpeg;
  const int error = StartOnSocket(
      "ffmpeg", CommandLine(writer.FilmPath(), width, height, frames_per_second), &ffmpeg);
  if (error == ENOENT) {
    return Status(StatusCode::kUnsupported,
                  "a video needs the program ffmpeg (Debian: apt install ffmpeg)");
  }
  if (error != 0) return IoError("start", "ffmpeg", error);
  writer.process_id_ = ffmpeg.process_id;
  writer.pipe_ = std::move(ffmpeg.socket);
  return writer;
}

Status VideoWriter::Failed() {
  return Status(StatusCode::kIoError, fmt::format("ffmpeg cannot write {}", path_));
}

Status VideoWriter::Write(std::span<const uint8_t> frame) {
  const Status sent = SendAll(pipe_.get(), std::as_bytes(frame), Deadline::AfterMs(kFrameMs));
  return sent.ok() ? sent : Failed();
}

Status VideoWriter::Finish(Existing existing) {
  pipe_ = UniqueFd();  // ends ffmpeg's input
  const int wait_status = WaitForExit(process_id_, Deadline::AfterMs(kFinishMs));
  process_id_ = 0;
  if (wait_status != 0) return Failed();  // a signal, or another exit code than 0
  return MoveTo(FilmPath(), path_, existing);
}

}  // namespace b4mrl
