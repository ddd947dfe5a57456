#include "benchmarks/runner/progress_line.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <string_view>

#include "algorithms/base/progress.h"

namespace b4mrl {

std::string TextOf(const SuiteProgress& progress) {
  const size_t begun = progress.done + progress.failed + progress.running;
  return fmt::format("{} of {} runs done, {} running, {} left, {:.1f} runs an hour, {} left",
                     progress.done, progress.runs, progress.running,
                     progress.runs - std::min(progress.runs, begun),
                     static_cast<double>(progress.done_meanwhile) / progress.hours,
                     FormatDuration(progress.seconds_left));
}

ProgressLine::ProgressLine(bool quiet)
    : quiet_(quiet), terminal_(!quiet && isatty(STDERR_FILENO) == 1) {}

void ProgressLine::Message(const std::string& text) {
  if (quiet_) return;
  const std::string shown = shown_;
  Erase();
  Tell(text + "\n");
  Show(shown);
}

void ProgressLine::Show(const std::string& text) {
  if (!terminal_ || text == shown_) return;
  Tell(fmt::format("\r{}\x1b[K", std::string_view(text).substr(0, ColumnsOfTerminal())));
  shown_ = text;
}

void ProgressLine::Erase() {
  if (!shown_.empty()) Tell("\r\x1b[K");
  shown_.clear();
}

}  // namespace b4mrl
