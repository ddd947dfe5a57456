// The legend of a figure: a swatch and a name for each series. Pure functions; any thread.
#pragma once

#include "algorithms/pictures/figure.h"
#include "algorithms/pictures/svg.h"

namespace b4mrl {

// Draws the legend of a figure with several series, in as many lines of `width` pixels as it needs,
// below `corner`. Returns its height: 0 where there is no legend.
double DrawLegend(const Figure& figure, Point corner, double width, SvgWriter* svg);

}  // namespace b4mrl
