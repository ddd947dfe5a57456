// Axes: what they show, in which unit, over which range, and the round numbers marked on them.
//
// Pure functions and value types; any thread; no locale.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace b4mrl {

// A linear axis from `low` to `high`, both finite and low < high. AxisRange::Around gives such
// bounds for any data, FitX and FitY (fit.h) for marks.
struct Axis {
  std::string name;  // "episode return"
  std::string unit;  // "m/s"; "" prints the name alone
  double low = 0;
  double high = 1;
  bool whole = false;  // marks whole numbers alone, as for counts
  // Named places instead of numbers: the first one is at value 0, the next one at 1. They stand
  // from left to right, or from top to bottom.
  std::vector<std::string> places;

  // An axis of at least one place.
  static Axis OfPlaces(std::string name, std::vector<std::string> places);
  std::string Title() const;  // "v-root-z (m/s)"
};

// Bounds of an axis for data between `low` and `high`: the same ones, unless they are so near each
// other that no numbers between them could be told apart; then wider ones around them.
struct AxisRange {
  double low = 0;
  double high = 0;
  static AxisRange Around(double low, double high);
};

// A marked number of an axis.
struct Tick {
  double value = 0;
  std::string label;  // "-0.25", "12,000", "2.5e6", distinct among the ticks; or a place's name
};

// The least of the numbers 1, 2 and 5 times a power of ten that is not below `least`, which is
// positive and finite.
double RoundStep(double least);

// All multiples of one round step within the axis, with the smallest step that makes at most `most`
// (at least 1) of them. An axis of places has one tick for each.
std::vector<Tick> Ticks(const Axis& axis, size_t most);

}  // namespace b4mrl
