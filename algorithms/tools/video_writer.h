// A video file, written by the program ffmpeg (which must be installed): raw pictures in, H.264
// out. It is filmed into a folder of its own beside its place, so that what lies in its place stays
// until the film is whole. Thread rule: one thread. Every wait is bounded: an ffmpeg that stops
// reading is ended.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <span>
#include <string>

#include "data/files/atomic_file.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

class VideoWriter {
 public:
  // `path` is the file that Finish makes; its ending chooses the container (".mp4"). Width and
  // height, in pixels, must be even, as H.264 demands. kUnsupported if ffmpeg is not installed,
  // kIoError if nothing can be written beside `path`.
  static Result<VideoWriter> Open(const std::string& path, uint32_t width, uint32_t height,
                                  double frames_per_second);
  VideoWriter(VideoWriter&& other) noexcept;
  VideoWriter& operator=(VideoWriter&&) = delete;
  // Ends ffmpeg and removes what it has filmed, unless Finish was called.
  ~VideoWriter();

  // Adds a picture. `frame`: height x width x (red, green, blue), top row first. kIoError when
  // ffmpeg does not take the picture; ffmpeg reports the reason on stderr.
  Status Write(std::span<const uint8_t> frame);
  // Waits until ffmpeg has completed the film and puts it in its place. A file that lies there is
  // replaced, or kept with kFailedPrecondition, as `existing` says. kIoError if one of them failed.
  Status Finish(Existing existing);

 private:
  VideoWriter(std::string path, std::string folder);
  // Where it is filmed.
  std::string FilmPath() const;
  Status Failed();

  std::string path_;
  std::string folder_;    // holds the unfinished film alone; "" once another object has it
  pid_t process_id_ = 0;  // of ffmpeg; 0 while it does not run
  UniqueFd pipe_;
};

}  // namespace b4mrl
