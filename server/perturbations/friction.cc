// friction=FACTOR: all three friction coefficients of every geom of the compiled model times a
// factor, the floor's included, because a contact has the larger coefficient of its two geoms. A
// user's model may name pairs of geoms with coefficients of their own (<pair>), which contacts of
// these pairs have instead. Preset: 0.3.
#include <mujoco/mujoco.h>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class Friction final : public NumberPerturbation {
 public:
  using NumberPerturbation::NumberPerturbation;

  Status OnModel(mjModel* model, double factor) const override {
    for (int i = 0; i < 3 * model->ngeom; ++i) model->geom_friction[i] *= factor;
    for (int i = 0; i < 5 * model->npair; ++i) model->pair_friction[i] *= factor;
    return Status();
  }
};

constexpr Preset kPresets[] = {{"friction", "HalfCheetah", "friction", "0.3"},
                               {"friction", "Walker2d", "friction", "0.3"}};

}  // namespace

extern const PerturbationEntry kFriction;  // its line in list.cc
constinit const PerturbationEntry kFriction = {
    .name = "friction",
    .parameter = "factor",
    .type = "number",
    .low = 0,  // MuJoCo itself never goes below 1e-5 in a contact
    .high = 100,
    .takes_range = true,
    .description = "multiplies the friction of every geom of the simulator, the floor included",
    .needs = kMujocoModel,
    .presets = kPresets,
    .make = MakeNumberPerturbation<Friction>};

}  // namespace b4mrl
