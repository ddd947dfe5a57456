// Draws one panel of a figure: title, notes, axes with ticks, marks.
//
// The panels of a row share one PanelLayout, which leaves room for the longest texts among them,
// and all rows of a figure have the same left and right edges, so that axes stand in line. Pure
// functions; any thread.
#pragma once

#include <span>

#include "algorithms/pictures/figure.h"
#include "algorithms/pictures/svg.h"

namespace b4mrl {

// Distances in pixels from a panel's top left corner.
struct PanelLayout {
  double width = 0, height = 0;  // of the whole panel
  double plot_left = 0, plot_right = 0;
  double plot_top = 0, plot_bottom = 0;
  double most_names = 0;  // the width of the longest line of a place's name beside the plot
};

// The layout of the panels `row` of `figure`. A row without any marks has the height of its texts.
PanelLayout LayoutOf(const Figure& figure, std::span<const Panel> row);

void DrawPanel(const Panel& panel, const PanelLayout& layout, Point corner, SvgWriter* svg);

}  // namespace b4mrl
