#include "server/log/stderr_log.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <climits>
#include <memory>
#include <string_view>

namespace b4mrl {
namespace {

constexpr std::string_view kCut = "...\n";  // the end of a line that was too long

}  // namespace

void LogToStderr(const std::string& pattern) {
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("b4mrl", std::make_shared<NonblockingSink>(STDERR_FILENO)));
  spdlog::default_logger()->set_pattern(pattern);
}

NonblockingSink::NonblockingSink(int fd) : fd_(fd) {
  struct stat info {};
  if (fstat(fd, &info) != 0) return;
  is_socket_ = S_ISSOCK(info.st_mode);
  // O_NONBLOCK belongs to what open() made, which this process shares with whoever started it. So
  // it is set on an opening of our own. A file is not opened anew: its position is shared, too.
  if (S_ISFIFO(info.st_mode) || S_ISCHR(info.st_mode)) {
    own_ = UniqueFd(open(fmt::format("/proc/self/fd/{}", fd).c_str(),
                         O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  }
}

void NonblockingSink::sink_it_(const spdlog::details::log_msg& message) {
  if (dropped_ > 0) {
    const std::string count =
        fmt::format("{} lines of the log were dropped here, since nobody read them", dropped_);
    if (!WriteLine({message.time, {}, message.logger_name, spdlog::level::warn, count})) {
      ++dropped_;
      return;
    }
    dropped_ = 0;
  }
  if (!WriteLine(message)) ++dropped_;
}

bool NonblockingSink::WriteLine(const spdlog::details::log_msg& message) {
  spdlog::memory_buf_t line;
  formatter_->format(message, line);
  if (line.size() > PIPE_BUF) {
    line.resize(PIPE_BUF - kCut.size());
    line.append(kCut.data(), kCut.data() + kCut.size());
  }
  return WriteNow(line.data(), line.size()) == static_cast<ssize_t>(line.size());
}

ssize_t NonblockingSink::WriteNow(const char* bytes, size_t size) {
  const int fd = own_.valid() ? own_.get() : fd_;
  pollfd ready{fd, POLLOUT, 0};
  if (poll(&ready, 1, 0) < 0) return -1;
  // Nobody reads what polls with an error; a write to such a pipe would raise SIGPIPE.
  if ((ready.revents & ~POLLOUT) != 0) return -1;
  if (is_socket_) return send(fd, bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL);
  // What another user has opened, and this one may not open again, can only be asked: a pipe that
  // is ready has room for PIPE_BUF bytes.
  if (!own_.valid() && ready.revents == 0) return -1;
  return write(fd, bytes, size);
}

}  // namespace b4mrl
