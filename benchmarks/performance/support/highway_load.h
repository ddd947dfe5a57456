// The load of Highway's measurements: settings, actions, and the bare highway simulator without
// environment, lanes or sockets. One thread an object.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "server/highway/neighbours.h"
#include "server/highway/settings.h"
#include "server/highway/simulation.h"

namespace b4mrl::perf {

inline constexpr size_t kHighwayActionSize = 2;

// Settings of the paper's simulator: highway-fast-v0 with 15 other cars, 5 frames a step.
HighwaySettings HighwayTask();

// Random actions, row-major, the same at every call: any throttle, but little steering, so that
// episodes last.
std::vector<float> HighwayActions(size_t rows);

// Simulates one episode after another, as a lane would: reset, step, observation, reward.
class BareHighway {
 public:
  // `settings` outlives the object.
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

// The C library's functions that the formulas of some steps call, with their arguments: powers for
// the driver's model and for deciding on lane changes and, for every car that is not exactly
// straight in the middle of its lane, the trigonometry of its steering and motion. Calls with
// argument 0 are left out, because their results are known.
class LibraryCalls {
 public:
  // Records `steps` steps of a bare highway.
  LibraryCalls(const HighwaySettings& settings, std::span<const float> actions, size_t steps);

  // Makes all recorded calls. Returns the sum of the results, so that no call is optimised away.
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
  std::vector<double> angles_;  // arguments of sine and cosine
  std::vector<double> sines_;
  std::vector<double> tangents_;
  std::vector<double> arc_sines_;
  std::vector<double> arc_tangents_;
};

}  // namespace b4mrl::perf
