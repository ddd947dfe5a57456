// The pairs of geoms of a model that can ever touch, listed once instead of searched in each step.
#pragma once

#include <mujoco/mujoco.h>

#include <vector>

namespace b4mrl {

inline constexpr int kMaxCollisionPairs = 256;  // so many tests cost less than the engine's search

// Columns of mjModel's table of predefined pairs of geoms. A pair has one entry in a column, or the
// number of entries that stands behind the column.
struct CollisionPairs {
  std::vector<int> geom1, geom2, dimension, signature;
  std::vector<mjtNum> reference;  // mjNREF entries a pair
  std::vector<mjtNum> impedance;  // mjNIMP entries a pair
  std::vector<mjtNum> margin, gap;
  std::vector<mjtNum> friction;  // 5 entries a pair

  int size() const { return static_cast<int>(geom1.size()); }
};

// Lets `model` simulate with equal bits, but faster: a fifth of the time of the planar tasks'
// mj_step, and a seventh of the Humanoid's, goes into the engine's broad phase, which sorts the
// bodies along an axis to find candidates among the few pairs that there are. Instead the model
// gets a list of all pairs, in the order in which the engine would have met them and with the
// contact parameters that it would have mixed: MuJoCo documentation, "Computation", "Collision
// detection", and "Modeling", "Contact parameters". The engine still tests the bounding spheres of
// a pair before it computes anything of its contact.
//
// `model` stays as it is, with the engine's own search, where it has pairs or excluded pairs of its
// own, restricts collisions, has geoms of different priorities, or would need more than
// kMaxCollisionPairs. Call this when nothing will change the contact parameters of geoms any more:
// later changes do not reach the pairs. The returned table has to outlive the model's use (moving
// it is allowed), and mj_copyModel refuses a model with listed pairs.
CollisionPairs ListCollisionPairs(mjModel* model);

}  // namespace b4mrl
