// Messages on stderr and, on a terminal, one line below them that is redrawn: how far the work is.
// Thread rule: one thread.
#pragma once

#include <string>

namespace b4mrl {

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
