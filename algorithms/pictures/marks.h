// Draws the marks of a panel into its plot. Pure functions; any thread.
#pragma once

#include <string>

#include "algorithms/pictures/figure.h"
#include "algorithms/pictures/svg.h"

namespace b4mrl {

// Where the values of an axis lie, in pixels.
struct Scale {
  double low, high;   // values
  double start, end;  // their pixels
  double At(double value) const { return start + (value - low) / (high - low) * (end - start); }
};

// The area inside a panel's axes, at its place in the picture.
struct Plot {
  const Panel& panel;
  double left, right, top, bottom;
  Scale x, y;
  SvgWriter* svg;
};

// The mark lies within the plot's axes.
void DrawMark(const Plot& plot, const Mark& mark);

// The path of a series' symbol around `centre`. Symbols repeat later than colours do, so that two
// series have both in common only after some ninety of them.
std::string SymbolPath(size_t series, Point centre);

}  // namespace b4mrl
