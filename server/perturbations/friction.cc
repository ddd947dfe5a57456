// friction=FACTOR: all three friction coefficients of every geom of the compiled model times a
// factor, the floor's included, because MuJoCo takes the larger of a pair's. Preset: 0.3.
#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr double kLow = 0;  // MuJoCo itself never goes below 1e-5 in a contact
constexpr double kHigh = 100;

class Friction final : public Perturbation {
 public:
  explicit Friction(double factor) : factor_(factor) {}

  NamedArgument ToNamedArgument() const override {
    return {"friction", fmt::format("{}", factor_)};
  }

  Status OnModel(mjModel* model) const override {
    for (int i = 0; i < 3 * model->ngeom; ++i) model->geom_friction[i] *= factor_;
    return Status();
  }

 private:
  double factor_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const double factor, ParseFinite("friction", input.argument, kLow, kHigh));
  return std::unique_ptr<Perturbation>(std::make_unique<Friction>(factor));
}

}  // namespace

extern const PerturbationEntry kFriction;  // its line in list.cc
constinit const PerturbationEntry kFriction = {
    .name = "friction",
    .parameter = "factor",
    .type = "number",
    .low = kLow,
    .high = kHigh,
    .description = "multiplies the friction of every geom of the simulator, the floor included",
    .corrupts_datasets = false,
    .applies = HasModel,
    .make = Make};

}  // namespace b4mrl
