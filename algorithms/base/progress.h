// Progress of a long piece of work, on stderr.
//
// On a terminal: one line that is redrawn at most ten times a second, with a bar, the rate and the
// time left; a narrow terminal shows no bar, and as much of the rest as there is room for.
// Elsewhere: a plain line every 30 seconds and one at the end, so that a log stays short. Other
// messages go through Message, which keeps the bar intact. Thread rule: one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "proto/base/clock.h"

namespace b4mrl {

class Progress {
 public:
  // Draws nothing at all when `quiet`.
  explicit Progress(bool quiet = false);
  ~Progress() { Finish(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // Begins a stage: "train", counted in "updates" from `first` to `total`; 0 where nobody knows how
  // many there will be.
  void Start(std::string_view stage, std::string_view unit, uint64_t total, uint64_t first = 0);
  // `note` is shown behind the numbers ("score 31.2").
  void Update(uint64_t done, std::string_view note = "");
  // Shows `note` behind the numbers from now on.
  void Note(std::string_view note) { note_ = note; }
  void Message(std::string_view text);
  // Ends the open stage with a last line; does nothing if no stage is open.
  void Finish();

 private:
  std::string Line(bool with_bar) const;
  void Erase();

  bool quiet_;
  bool terminal_;
  bool open_ = false;
  bool drawn_ = false;
  std::string stage_, unit_, note_;
  uint64_t first_ = 0, total_ = 0, done_ = 0;
  Clock::time_point start_, last_drawn_;
};

// Writes to stderr what nobody has to read. What cannot be written is dropped: work does not end
// because its terminal was closed or a disk is full, as it would by the exceptions of fmt::print.
void Tell(std::string_view text);

// How many characters of a line the terminal of stderr shows so that the line can be drawn over; as
// many as there may be where that is not known.
size_t ColumnsOfTerminal();

// A duration as "h:mm:ss", or as "m:ss" below one hour.
std::string FormatDuration(double seconds);

}  // namespace b4mrl
