// How all cars but the ego drive: the intelligent driver model along the road (Treiber, Hennecke,
// Helbing, "Congested traffic states in empirical observations and microscopic simulations", 2000),
// MOBIL for lane changes (Kesting, Treiber, Helbing, "General lane-changing model MOBIL", 2007)
// and a steering controller, with highway-env's constants and order of operations.
#pragma once

#include "server/highway/neighbours.h"
#include "server/highway/traffic.h"

namespace b4mrl {

// Decides for all cars but the ego, in the order of the list, and stores their steering,
// acceleration, target lane and timer. The cars that decide later in the order know the target
// lanes chosen before. `neighbours` has been updated since the cars last moved.
void Drive(Traffic& traffic, const Neighbours& neighbours, int lanes);

// The steering angle, in rad, that brings a car to the centre of `lane`.
double SteeringTowards(const Traffic& traffic, int vehicle, int lane);

// The acceleration without a car in front, in m/s2, of a driver with exponent `delta`.
double FreeAcceleration(const Traffic& traffic, int vehicle, double delta);
// By how much the car `front` lowers the free acceleration of `vehicle`: m/s2, never negative.
double Interaction(const Traffic& traffic, int vehicle, int front);

}  // namespace b4mrl
