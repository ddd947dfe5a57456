// Figures: a grid of panels with axes, marks, a legend and text, drawn as one SVG document.
//
// A figure is a value that says what is to be seen; RenderSvg places it so that nothing overlaps,
// whatever the lengths of texts and numbers. All panels of a figure have one size. A new kind of
// mark is a struct in Mark with functions in marks.cc, legend.cc and fit.cc. Pure; any thread;
// equal figures give equal bytes.
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

// A bar from 0 to a value along the axis of numbers, at a place of the other axis.
struct Bar {
  double at = 0;  // a place's number, with Dodge where several bars stand side by side
  double value = 0;
  std::optional<AxisRange> interval;  // drawn as a whisker
  bool open = false;                  // not filled, for what is not certain yet
  std::string hint;                   // shown while the pointer rests on it
};

// Bars of one series on a panel with one axis of places: upright, or towards the right where the
// places are those of y.
struct Bars {
  size_t series = 0;
  double width = 0.8;  // of each bar; the distance between places is 1
  std::vector<Bar> bars;
};

// A point with a whisker along x, along y, along both or along none.
struct Dot {
  double x = 0, y = 0;
  std::optional<AxisRange> x_interval, y_interval;
  bool open = false;  // not filled, for what is not certain yet
  std::string hint;   // shown while the pointer rests on it
};

// Points of one series, drawn with the series' own symbol.
struct Dots {
  size_t series = 0;
  std::vector<Dot> dots;
};

// Points joined by straight lines. Without a series it is a line of reference in the axes' colour.
struct Line {
  std::optional<size_t> series;
  bool dashed = false;
  std::vector<double> x, y;  // equally many
};

// What lies between `low` and `high` at each x: an interval around a line.
struct Band {
  size_t series = 0;
  std::vector<double> x, low, high;  // equally many
};

// A vertical line at one value of x, with its name beside it at the panel's upper end.
struct Rule {
  double x = 0;
  std::string name;  // "" for none
};

// A horizontal line at one value of y.
struct Level {
  double y = 0;
};

using Mark = std::variant<Columns, Bars, Dots, Line, Band, Rule, Level>;

// Where the thing `number` of `count` stands that share one place side by side: its distance from
// the place's value, where all of them together take `share` of the distance between places.
inline double Dodge(size_t number, size_t count, double share = 0.8) {
  return ((static_cast<double>(number) + 0.5) / static_cast<double>(count) - 0.5) * share;
}

struct Panel {
  std::string title;
  std::vector<std::string> notes;  // lines of text below the title, wrapped to the panel's width
  Axis x, y;
  // The same quantity as x in another unit, at the panel's upper end: linear, from the value at
  // x.low to the value at x.high.
  std::optional<Axis> upper_x;
  // Finite and within the axes, which FitX and FitY (fit.h) see to. The later ones stand over the
  // earlier ones; a panel without any has text alone.
  std::vector<Mark> marks;
};

struct Figure {
  std::string title;
  std::vector<std::string> sentences;  // below the title, each from a new line on
  // Names of what is compared. If there are several, a legend shows those that have marks, each as
  // they look.
  std::vector<std::string> series;
  size_t columns = 1;        // panels beside each other
  double panel_width = 720;  // pixels, with the texts of the axes
  double plot_height = 300;  // pixels, of the area inside the axes; more where named places need it
  std::vector<Panel> panels;  // row by row
};

std::string RenderSvg(const Figure& figure);

}  // namespace b4mrl
