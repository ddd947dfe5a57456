// A video file, written by the program ffmpeg (which must be installed): raw pictures in, H.264
// out. Thread rule: one thread. Every wait is bounded: an ffmpeg that stops reading is ended.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <span>
#include <string>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

class VideoWriter {
 public:
  // Replaces the file `path`, whose ending chooses the container (".mp4"). Width and height, in
  // pixels, must be even, as H.264 demands. kUnsupported if ffmpeg is not installed.
  static Result<VideoWriter> Open(const std::string& path, uint32_t width, uint32_t height,
                                  double frames_per_second);
  VideoWriter(VideoWriter&& other) noexcept;
  VideoWriter& operator=(VideoWriter&&) = delete;
  // Ends ffmpeg and removes the file, unless Finish was called.
  ~VideoWriter();

  // Adds a picture. `frame`: height x width x (red, green, blue), top row first. kIoError when
  // ffmpeg does not take the picture; ffmpeg reports the reason on stderr.
  Status Write(std::span<const uint8_t> frame);
  // Waits until ffmpeg has completed the file. kIoError if ffmpeg failed; the file is then removed.
  Status Finish();

 private:
  VideoWriter(std::string path, pid_t process_id, UniqueFd pipe);
  Status Failed();

  std::string path_;
  pid_t process_id_;
  UniqueFd pipe_;
};

}  // namespace b4mrl
