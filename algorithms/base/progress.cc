#include "algorithms/base/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace b4mrl {
namespace {

constexpr double kTerminalSeconds = 0.1;
constexpr double kPlainSeconds = 30;
constexpr int kBarWidth = 24;

std::string FormatRate(double rate, std::string_view unit) {
  return rate >= 10 ? fmt::format("{:.0f} {}/s", rate, unit)
                    : fmt::format("{:.2f} {}/s", rate, unit);
}

}  // namespace

void Tell(std::string_view text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

size_t ColumnsOfTerminal() {
  winsize window{};
  const bool has_width = ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 0;
  return has_width ? window.ws_col - 1 : std::string::npos;  // the cursor takes the last column
}

std::string FormatDuration(double seconds) {
  const auto whole = static_cast<int64_t>(std::max(seconds, 0.0) + 0.5);
  if (whole >= 3600) {
    return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
  }
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void Progress::Start(std::string_view stage, std::string_view unit, uint64_t total,
                     uint64_t first) {
  Finish();
  stage_ = stage;
  unit_ = unit;
  note_.clear();
  total_ = total;
  first_ = done_ = first;
  start_ = last_drawn_ = Clock::now();
  open_ = true;
}

void Progress::Update(uint64_t done, std::string_view note) {
  done_ = done;
  if (!note.empty()) note_ = note;
  if (quiet_ || !open_) return;
  if (SecondsSince(last_drawn_) < (terminal_ ? kTerminalSeconds : kPlainSeconds)) return;
  last_drawn_ = Clock::now();
  drawn_ = terminal_;
  if (!terminal_) return Tell(Line(false) + "\n");
  const size_t columns = ColumnsOfTerminal();
  std::string line = Line(true);
  if (line.size() > columns) line = Line(false).substr(0, columns);
  Tell("\r" + line + "\x1b[K");
}

void Progress::Message(std::string_view text) {
  if (quiet_) return;
  Erase();
  Tell(fmt::format("{}\n", text));
}

void Progress::Finish() {
  if (!open_) return;
  open_ = false;
  if (quiet_) return;
  Erase();
  const double seconds = SecondsSince(start_);
  const double rate = seconds > 0 ? static_cast<double>(done_ - first_) / seconds : 0;
  Tell(fmt::format("{}: {} {} in {} ({}){}{}\n", stage_, done_, unit_, FormatDuration(seconds),
                   FormatRate(rate, unit_), note_.empty() ? "" : ", ", note_));
}

std::string Progress::Line(bool with_bar) const {
  const double seconds = SecondsSince(start_);
  const double rate = seconds > 0 ? static_cast<double>(done_ - first_) / seconds : 0;
  const uint64_t rest = total_ > done_ ? total_ - done_ : 0;
  const std::string left =
      rate > 0 ? FormatDuration(static_cast<double>(rest) / rate) + " left" : "";
  const std::string time = total_ > 0 ? left : FormatDuration(seconds) + " so far";
  const std::string of_all = total_ > 0 ? fmt::format("/{}", total_) : "";
  std::string bar;
  if (with_bar && total_ > 0) {
    const double fraction = std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
    const int full = static_cast<int>(fraction * kBarWidth);
    bar = fmt::format("[{}{}] ", std::string(full, '#'), std::string(kBarWidth - full, '.'));
  }
  return fmt::format("{} {}{}{} {}, {}, {}{}{}", stage_, bar, done_, of_all, unit_,
                     FormatRate(rate, unit_), time, note_.empty() ? "" : ", ", note_);
}

void Progress::Erase() {
  if (drawn_) Tell("\r\x1b[K");
  drawn_ = false;
}

}  // namespace b4mrl
