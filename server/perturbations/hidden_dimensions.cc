// hidden=A+B+...: sets dimensions of observations to 0. Dimensions are 0-based indices or names;
// where an observation has rows, a feature's name ("vx") stands for its column of every row.
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class HiddenDimensionsPerturbation final : public Perturbation {
 public:
  explicit HiddenDimensionsPerturbation(std::vector<uint32_t> dimensions)
      : dimensions_(std::move(dimensions)) {}

  NamedArgument ToNamedArgument() const override {
    std::string argument;
    for (const uint32_t dimension : dimensions_) {
      argument += (argument.empty() ? "" : "+") + std::to_string(dimension);
    }
    return {"hidden", argument};
  }

  void OnObservation(const DrawContext& /*context*/, std::span<double> /*state*/,
                     std::span<double> observation) const override {
    for (const uint32_t dimension : dimensions_) observation[dimension] = 0;
  }

 private:
  std::vector<uint32_t> dimensions_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(std::vector<uint32_t> dimensions,
                         input.spec->observation.ParseDimensions(input.argument));
  return std::unique_ptr<Perturbation>(
      std::make_unique<HiddenDimensionsPerturbation>(std::move(dimensions)));
}

// Indices of the observation that an environment has by default, as in the paper
// (ResolvePerturbation).
constexpr Preset kPresets[] = {
    {"hidden-low", "HalfCheetah", "hidden", "16"}, {"hidden-low", "Hopper", "hidden", "9"},
    {"hidden-low", "Walker2d", "hidden", "16"},    {"hidden-low", "Highway", "hidden", "vx+vy"},
    {"hidden-high", "HalfCheetah", "hidden", "9"}, {"hidden-high", "Hopper", "hidden", "10"},
    {"hidden-high", "Walker2d", "hidden", "9"},    {"hidden-high", "Highway", "hidden", "y+vx+vy"}};

}  // namespace

extern const PerturbationEntry kHiddenDimensions;  // its line in list.cc
constinit const PerturbationEntry kHiddenDimensions = {
    .name = "hidden",
    .parameter = "dimensions",
    .type = "dimensions",
    .description = "sets dimensions of observations to 0; indices, names or features joined by +",
    .corrupts_datasets = true,
    .presets = kPresets,
    .make = Make};

}  // namespace b4mrl
