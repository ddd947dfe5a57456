// Runners in the x-z plane: three root joints (x, z, pitch) and hinges, as many velocities as
// coordinates.
//   observation  qpos without x (with it, if positions are not excluded), then qvel clipped to
//                +-velocity_limit. A query starts a clipped velocity at the limit.
#pragma once

#include <span>

#include "server/environments/mujoco/locomotion.h"

namespace b4mrl {

class PlanarRunner : public Locomotion {
 public:
  void Observe(std::span<double> observation) const override;

 protected:
  PlanarRunner(const EnvironmentSpec& spec, const LocomotionSettings& settings,
               std::span<const InfoColumn> infos, MujocoScratch scratch, double velocity_limit)
      : Locomotion(spec, settings, infos, std::move(scratch)), velocity_limit_(velocity_limit) {}

  void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                            std::span<double> qvel) const override;

  double height() const { return data().qpos[1]; }
  double pitch() const { return data().qpos[2]; }

 private:
  double velocity_limit_;
};

// The parts of a specification that follow from the joints: dimensions "rootz", "rooty", the
// joints, "v-root-x", "v-root-z", "v-rooty", "v-<joint>" ("rootx" first if positions are not
// excluded), unbounded as in Gymnasium; one action in -1..1 for each joint.
EnvironmentSpec DescribePlanarRunner(const char* name, std::span<const char* const> joints,
                                     const LocomotionSettings& settings);

// The settings of the runners that can fall, Hopper and Walker2d; their healthy ranges differ.
LocomotionSettings ReadPlanarWalkerSettings(ConfigReader& reader, Interval healthy_z,
                                            Interval healthy_angle);

// Info columns of Hopper and Walker2d.
std::span<const InfoColumn> PlanarWalkerInfos(const LocomotionSettings& settings);

// Index of the torso's height in the observation of Hopper and Walker2d; the pitch is the next.
inline uint32_t HeightDimension(const LocomotionSettings& settings) {
  return settings.with_positions ? 1 : 0;
}

// Fills in what Hopper and Walker2d share: reward, infos, step limit, termination by the healthy
// ranges of height and pitch, and the lower legs as a feature that perturbations may change.
void DescribePlanarWalker(const LocomotionSettings& settings, EnvironmentSpec* spec);

}  // namespace b4mrl
