// Where the daemon's processes log: to stderr, and never waiting for whoever reads it.
//
// A reader that stands still (a pipe that nobody empties, a terminal that was stopped) costs lines
// instead of time: a line that does not fit at once is dropped and counted, and the next one that
// fits stands behind a line with the count. Any thread may log.
#pragma once

#include <spdlog/sinks/base_sink.h>

#include <cstdint>
#include <mutex>
#include <string>

#include "proto/base/unique_fd.h"

namespace b4mrl {

// Lets this process log to stderr, in lines of spdlog's `pattern`. To be called before the process
// gives up rights, at its start.
void LogToStderr(const std::string& pattern);

// Writes each line whole, or cut to PIPE_BUF bytes, which a pipe takes in one piece.
class NonblockingSink : public spdlog::sinks::base_sink<std::mutex> {
 public:
  // `fd` outlives the sink and keeps its flags, as other processes may share them.
  explicit NonblockingSink(int fd);

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override;
  void flush_() override {}  // nothing is buffered

 private:
  // Whether the line has been written.
  bool WriteLine(const spdlog::details::log_msg& message);
  // Writes at most as many bytes as fit now; returns how many, or -1.
  ssize_t WriteNow(const char* bytes, size_t size);

  int fd_;
  bool is_socket_ = false;
  UniqueFd own_;  // the pipe or terminal of fd_, opened once more; invalid for anything else
  uint64_t dropped_ = 0;  // since the last line that was written
};

}  // namespace b4mrl
