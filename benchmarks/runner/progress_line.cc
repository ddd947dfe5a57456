#include "benchmarks/runner/progress_line.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace b4mrl {

ProgressLine::ProgressLine(bool quiet)
    : quiet_(quiet), terminal_(!quiet && isatty(STDERR_FILENO) == 1) {}

void ProgressLine::Message(const std::string& text) {
  if (quiet_) return;
  const std::string shown = shown_;
  Erase();
  fmt::print(stderr, "{}\n", text);
  Show(shown);
}

void ProgressLine::Show(const std::string& text) {
  if (!terminal_ || text == shown_) return;
  fmt::print(stderr, "\r{}\x1b[K", text);
  std::fflush(stderr);
  shown_ = text;
}

void ProgressLine::Erase() {
  if (!shown_.empty()) fmt::print(stderr, "\r\x1b[K");
  shown_.clear();
}

}  // namespace b4mrl
