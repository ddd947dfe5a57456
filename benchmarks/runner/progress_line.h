// Messages on stderr and, on a terminal, one line below them that is redrawn: how far the work is.
// What cannot be written is dropped, and the work goes on.
// Thread rule: one thread.
#pragma once

#include <cstddef>
#include <string>

namespace b4mrl {

// How far a suite is.
struct SuiteProgress {
  size_t done = 0, failed = 0, running = 0, runs = 0;
  size_t done_meanwhile = 0;  // of `done`, in these hours
  double hours = 0;
  double seconds_left = 0;
};
std::string TextOf(const SuiteProgress& progress);

class ProgressLine {
 public:
  // Writes nothing at all when `quiet`.
  explicit ProgressLine(bool quiet);
  ~ProgressLine() { Erase(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  void Message(const std::string& text);
  // Draws the line anew, as much of it as the terminal is wide; "" erases it. Does nothing where
  // stderr is not a terminal.
  void Show(const std::string& text);

 private:
  void Erase();

  bool quiet_;
  bool terminal_;
  std::string shown_;
};

}  // namespace b4mrl
