// Moves the cars by one frame and finds their collisions.
#pragma once

#include "server/highway/settings.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// Carries out the stored commands for `dt` seconds by the kinematic bicycle model (Polack, Altche,
// d'Andrea-Novel, de La Fortelle, "The kinematic bicycle model", 2017; both axles half a car's
// length from the centre) and applies pending impacts. Crashed cars keep straight and brake. A car
// beyond its speed limits has its stored acceleration bounded.
void Move(Traffic& traffic, int lanes, const NumberRange& ego_speed_range, double dt);

// Separating axes over all pairs, the car with the lower index first. Pairs without the ego count
// only if `others_collide`. Cars that overlap are marked crashed; those that will within `dt` get
// an impact that the next Move applies.
void Collide(Traffic& traffic, bool others_collide, double dt);

}  // namespace b4mrl
