// Bounds of axes by what stands on them. Pure functions; any thread.
#pragma once

#include <span>

#include "algorithms/pictures/figure.h"

namespace b4mrl {

// Gives the axes x, or y, of all these panels the same bounds, so that panels can be compared: they
// hold every mark with its intervals and leave a margin around them. An axis along which bars run
// holds 0. An axis of places keeps its bounds, and so do axes without any mark.
void FitX(std::span<Panel> panels);
void FitY(std::span<Panel> panels);

}  // namespace b4mrl
