// What a picture of Highway shows: the road around the ego car, and all cars on that stretch.
// Proportions are those of highway-env's pictures (5.5 pixels a metre at 600 x 150, the ego at 0.3
// of the width); colours are ours. Pure function; any thread.
#pragma once

#include <cstdint>
#include <span>

#include "server/environments/canvas.h"

namespace b4mrl {

// `vehicles`: rows of kVehicleColumns (server/highway/traffic.h), at least one, the ego first.
// Lanes are 4 m wide and lie along x; lane i is centred at y = 4 i.
PlanView HighwayPlan(uint32_t lanes, std::span<const double> vehicles);

}  // namespace b4mrl
