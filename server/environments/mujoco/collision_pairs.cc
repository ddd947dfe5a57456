#include "server/environments/mujoco/collision_pairs.h"

#include <algorithm>
#include <functional>
#include <optional>

namespace b4mrl {
namespace {

// MuJoCo's rule: bodies that are welded together move as one and never touch; a body and its parent
// overlap at their joint, so they pass through each other, unless the parent is the world.
bool BodiesMayTouch(const mjModel& model, int body1, int body2) {
  const int weld1 = model.body_weldid[body1];
  const int weld2 = model.body_weldid[body2];
  if (weld1 == weld2) return false;
  if (weld1 == 0 || weld2 == 0 || (model.opt.disableflags & mjDSBL_FILTERPARENT)) return true;
  const int parent1 = model.body_weldid[model.body_parentid[weld1]];
  const int parent2 = model.body_weldid[model.body_parentid[weld2]];
  return weld1 != parent2 && weld2 != parent1;
}

bool GeomsMayTouch(const mjModel& model, int geom1, int geom2) {
  return (model.geom_contype[geom1] & model.geom_conaffinity[geom2]) ||
         (model.geom_contype[geom2] & model.geom_conaffinity[geom1]);
}

// Weight of the first geom, 0 to 1, in the mixed solver parameters of a pair.
mjtNum MixingWeight(mjtNum solmix1, mjtNum solmix2) {
  if (solmix1 >= mjMINVAL && solmix2 >= mjMINVAL) return solmix1 / (solmix1 + solmix2);
  if (solmix1 < mjMINVAL && solmix2 < mjMINVAL) return 0.5;
  return solmix1 < mjMINVAL ? 0 : 1;
}

void AddPair(const mjModel& model, int geom1, int geom2, CollisionPairs& pairs) {
  const int signature = (model.geom_bodyid[geom1] << 16) + model.geom_bodyid[geom2];
  // The engine's narrow phase knows each pair of shapes in one order only.
  if (model.geom_type[geom1] > model.geom_type[geom2]) std::swap(geom1, geom2);
  const auto larger = [&](const auto* values, int size, int k) {
    return std::max(values[geom1 * size + k], values[geom2 * size + k]);
  };
  const mjtNum weight = MixingWeight(model.geom_solmix[geom1], model.geom_solmix[geom2]);
  const auto mixed = [&](const mjtNum* values, int size, int k) {
    return weight * values[geom1 * size + k] + (1 - weight) * values[geom2 * size + k];
  };
  const mjtNum* reference = model.geom_solref;
  // Where a geom's solref is not positive, it is stiffness and damping; then the smaller one
  // counts.
  const bool standard = reference[geom1 * mjNREF] > 0 && reference[geom2 * mjNREF] > 0;

  pairs.geom1.push_back(geom1);
  pairs.geom2.push_back(geom2);
  pairs.signature.push_back(signature);
  pairs.dimension.push_back(larger(model.geom_condim, 1, 0));
  pairs.margin.push_back(larger(model.geom_margin, 1, 0));
  pairs.gap.push_back(larger(model.geom_gap, 1, 0));
  for (int k = 0; k < mjNREF; ++k) {
    pairs.reference.push_back(
        standard ? mixed(reference, mjNREF, k)
                 : std::min(reference[geom1 * mjNREF + k], reference[geom2 * mjNREF + k]));
  }
  for (int k = 0; k < mjNIMP; ++k) {
    pairs.impedance.push_back(mixed(model.geom_solimp, mjNIMP, k));
  }
  // A geom has one friction coefficient for sliding, one for spinning and one for rolling; a
  // contact has two sliding axes, one spinning axis and two rolling axes.
  for (const int k : {0, 0, 1, 2, 2}) pairs.friction.push_back(larger(model.geom_friction, 3, k));
}

// The pairs that can touch; nullopt where the engine's own search has to remain.
std::optional<CollisionPairs> FindPairs(const mjModel& model) {
  if (model.npair > 0 || model.nexclude > 0 || model.opt.collision != mjCOL_ALL) return {};
  const int* priorities = model.geom_priority;
  if (std::adjacent_find(priorities, priorities + model.ngeom, std::not_equal_to<>()) !=
      priorities + model.ngeom) {
    return {};
  }
  CollisionPairs pairs;
  for (int body1 = 0; body1 < model.nbody; ++body1) {
    for (int body2 = body1 + 1; body2 < model.nbody; ++body2) {
      if (!BodiesMayTouch(model, body1, body2)) continue;
      for (int i = 0; i < model.body_geomnum[body1]; ++i) {
        for (int j = 0; j < model.body_geomnum[body2]; ++j) {
          const int geom1 = model.body_geomadr[body1] + i;
          const int geom2 = model.body_geomadr[body2] + j;
          if (!GeomsMayTouch(model, geom1, geom2)) continue;
          if (pairs.size() == kMaxCollisionPairs) return {};
          AddPair(model, geom1, geom2, pairs);
        }
      }
    }
  }
  return pairs;
}

}  // namespace

CollisionPairs ListCollisionPairs(mjModel* model) {
  std::optional<CollisionPairs> pairs = FindPairs(*model);
  if (!pairs) return {};
  model->opt.collision = mjCOL_PAIR;
  model->npair = pairs->size();
  model->pair_dim = pairs->dimension.data();
  model->pair_geom1 = pairs->geom1.data();
  model->pair_geom2 = pairs->geom2.data();
  model->pair_signature = pairs->signature.data();
  model->pair_solref = pairs->reference.data();
  model->pair_solimp = pairs->impedance.data();
  model->pair_margin = pairs->margin.data();
  model->pair_gap = pairs->gap.data();
  model->pair_friction = pairs->friction.data();
  return *std::move(pairs);
}

}  // namespace b4mrl
