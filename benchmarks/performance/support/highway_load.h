// What Highway's measurements have in common: how the simulated road is driven, and the bare
// simulator under it, without environment, lanes or sockets. One thread an object.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "server/highway/neighbours.h"
#include "server/highway/settings.h"
#include "server/highway/simulation.h"

namespace b4mrl::perf {

inline constexpr size_t kHighwayActionSize = 2;

// The paper's simulator: highway-fast-v0 with 15 other cars, 5 frames a step.
HighwaySettings HighwayTask();

// Any throttle and little steering, so that episodes last; row after row, the same at every call.
std::vector<float> HighwayActions(size_t rows);

// One episode after another, as a lane would see them: reset, step, observation, reward.
class BareHighway {
 public:
  // `settings` outlives it.
  BareHighway(const HighwaySettings& settings, uint64_t seed);

  void Step(std::span<const float> action);

 private:
  const HighwaySettings& settings_;
  HighwaySimulation simulation_;
  uint64_t seed_;
  uint64_t episode_ = 0;
  bool ended_ = true;
  std::vector<double> observation_;
};

// The calls of the C library that the formulas of some steps make, with their arguments: powers for
// the driver's model and for thoughts about a lane change and, for every car that is not exactly
// straight in the middle of its lane, the trigonometry of its steering and motion. Calls whose
// argument is 0 are left out: their results need no call.
class LibraryCalls {
 public:
  // Records `steps` steps of a bare highway.
  LibraryCalls(const HighwaySettings& settings, std::span<const float> actions, size_t steps);

  // Makes all of them; the sum of the results, so that they are not optimised away.
  double Repeat() const;
  size_t size() const;
  size_t steps() const { return steps_; }

 private:
  struct Power {
    double base, exponent;
  };

  void RecordFrame(const Traffic& before, const Traffic& after);
  void RecordPower(const Traffic& traffic, int vehicle, double exponent);
  void RecordThought(const Traffic& traffic, int vehicle);

  size_t steps_;
  int lanes_;
  Neighbours neighbours_;
  std::vector<Power> powers_;
  std::vector<double> angles_;  // sine and cosine
  std::vector<double> sines_;
  std::vector<double> tangents_;
  std::vector<double> arc_sines_;
  std::vector<double> arc_tangents_;
};

}  // namespace b4mrl::perf
