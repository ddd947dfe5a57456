// gravity=FACTOR: the compiled model's gravity vector times a factor. Preset: 2 (the paper's 2 g).
#include <mujoco/mujoco.h>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class Gravity final : public NumberPerturbation {
 public:
  using NumberPerturbation::NumberPerturbation;

  Status OnModel(mjModel* model, double factor) const override {
    for (mjtNum& component : model->opt.gravity) component *= factor;
    return Status();
  }
};

constexpr Preset kPresets[] = {{"gravity", "HalfCheetah", "gravity", "2"},
                               {"gravity", "Hopper", "gravity", "2"},
                               {"gravity", "Walker2d", "gravity", "2"}};

}  // namespace

extern const PerturbationEntry kGravity;  // its line in list.cc
constinit const PerturbationEntry kGravity = {
    .name = "gravity",
    .parameter = "factor",
    .type = "number",
    .low = -10,  // a negative factor turns gravity upwards
    .high = 10,
    .takes_range = true,
    .description = "multiplies the gravity of the simulator",
    .needs = kMujocoModel,
    .presets = kPresets,
    .make = MakeNumberPerturbation<Gravity>};

}  // namespace b4mrl
