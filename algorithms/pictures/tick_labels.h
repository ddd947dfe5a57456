// Where the labels of an axis stand, so that none overlaps another: numbers, or the names of
// places, which are wrapped or turned. Pure functions; any thread.
#pragma once

#include <string>
#include <vector>

#include "algorithms/pictures/axis.h"

namespace b4mrl {

inline constexpr double kTickSize = 10;        // of labels
inline constexpr double kTickLineHeight = 12;  // between the lines of a label
// To the right of every plot: half of the last tick's label may stand in it.
inline constexpr double kRightMargin = 20;

struct TickLabel {
  double value = 0;
  std::vector<std::string> lines;
};

struct TickLabels {
  std::vector<TickLabel> labels;
  bool upwards = false;  // to be read from below
  double extent = 0;     // in pixels, away from the axis
};

// The labels of a horizontal axis of `width` pixels. Of numbers, as many as have room beside each
// other. The names of places are wrapped; where a word is too long for that they are turned; names
// that lack room even so are left out at equal distances.
TickLabels LabelsBelow(const Axis& axis, double width);

// The labels of a vertical axis of `height` pixels, where names have lines of at most `most`
// pixels.
TickLabels LabelsBeside(const Axis& axis, double height, double most);
// The least height of a vertical axis at which these labels do not overlap; 0 for an axis of
// numbers, which has as many labels as there is room for.
double LeastHeight(const Axis& axis, double most);

}  // namespace b4mrl
