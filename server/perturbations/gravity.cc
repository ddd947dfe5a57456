// gravity=FACTOR: the compiled model's gravity vector times a factor. Preset: 2 (the paper's 2 g).
#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr double kLow = -10;  // upwards
constexpr double kHigh = 10;

class Gravity final : public Perturbation {
 public:
  explicit Gravity(double factor) : factor_(factor) {}

  NamedArgument ToNamedArgument() const override { return {"gravity", fmt::format("{}", factor_)}; }

  Status OnModel(mjModel* model) const override {
    for (mjtNum& component : model->opt.gravity) component *= factor_;
    return Status();
  }

 private:
  double factor_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const double factor, ParseFinite("gravity", input.argument, kLow, kHigh));
  return std::unique_ptr<Perturbation>(std::make_unique<Gravity>(factor));
}

}  // namespace

extern const PerturbationEntry kGravity;  // its line in list.cc
constinit const PerturbationEntry kGravity = {
    .name = "gravity",
    .parameter = "factor",
    .type = "number",
    .low = kLow,
    .high = kHigh,
    .description = "multiplies the gravity of the simulator",
    .corrupts_datasets = false,
    .applies = HasModel,
    .make = Make};

}  // namespace b4mrl
