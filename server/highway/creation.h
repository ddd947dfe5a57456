// Creates the cars of an episode's start: those of highway-env for the same seed, number for
// number.
#pragma once

#include <cstdint>

#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// Speeds that other cars are created with, which are also their target speeds; m/s.
inline constexpr NumberRange kCreationSpeed = {21, 24};

// Fills `traffic` with the start of an episode. Episode 0 is that of reset(seed=seed), episode k
// that of the k-th reset() without a seed after it, where all episodes have the same number of
// vehicles; with most_vehicles they begin where those of that many would. The capacity is at least
// vehicles_count + 1.
void CreateTraffic(const HighwaySettings& settings, uint64_t seed, uint64_t episode,
                   Traffic& traffic);

// The timer of a new car at (x, y), seconds in [0, 1): spreads the drivers' lane changes in time.
double CreationTimer(double x, double y);

}  // namespace b4mrl
