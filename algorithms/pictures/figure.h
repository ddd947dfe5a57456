// Figures: a grid of panels with axes, marks, a legend and text, drawn as one SVG document.
//
// A figure is a value that says what is to be seen; RenderSvg places it so that nothing overlaps,
// whatever the lengths of texts and numbers. All panels of a figure have one size. A new kind of
// mark is a struct in Mark and a function in panel.cc. Pure; any thread; equal figures give equal
// bytes.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "algorithms/pictures/axis.h"

namespace b4mrl {

// Adjacent columns of equal width between two values of x: a histogram.
struct Columns {
  size_t series = 0;            // number among the figure's series, which gives the colour
  bool filled = false;          // the area below the outline, too
  double low = 0, high = 0;     // the left edge of the first column, the right edge of the last one
  std::vector<double> heights;  // finite, in values of y
};

// A vertical line at one value of x, with its name beside it at the panel's upper end.
struct Rule {
  double x = 0;
  std::string name;
};

using Mark = std::variant<Columns, Rule>;

struct Panel {
  std::string title;
  std::vector<std::string> notes;  // lines of text below the title, wrapped to the panel's width
  Axis x, y;
  // The same quantity as x in another unit, at the panel's upper end: linear, from the value at
  // x.low to the value at x.high.
  std::optional<Axis> upper_x;
  std::vector<Mark> marks;  // the later over the earlier ones; a panel without any has text alone
};

struct Figure {
  std::string title;
  std::vector<std::string> sentences;  // below the title, each from a new line on
  // Names of what is compared. A legend shows them if there are several: the first one as a filled
  // area, as its marks should be.
  std::vector<std::string> series;
  size_t columns = 1;         // panels beside each other
  double panel_width = 720;   // pixels, with the texts of the axes
  double plot_height = 300;   // pixels, of the area inside the axes
  std::vector<Panel> panels;  // row by row
};

std::string RenderSvg(const Figure& figure);

}  // namespace b4mrl
