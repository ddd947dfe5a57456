// obs-noise=STD: adds STD times an independent standard normal to every dimension of an
// observation. The normals are those of the row's place in the stream, whatever STD is: two levels
// scale one noise matrix.
#include <fmt/format.h>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr const char* kName = "obs-noise";
constexpr double kLow = 0;
constexpr double kHigh = 1e6;

class ObservationNoise final : public Perturbation {
 public:
  ObservationNoise(double std, uint64_t occurrence) : std_(std), occurrence_(occurrence) {}

  NamedArgument ToNamedArgument() const override { return {kName, fmt::format("{}", std_)}; }

  void OnObservation(const DrawContext& context, std::span<double> observation) const override {
    Rng rng = RowRng(context, kName, occurrence_, observation.size());
    for (double& value : observation) value += std_ * rng.Normal();
  }

 private:
  double std_;
  uint64_t occurrence_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const double std, ParseFinite(kName, input.argument, kLow, kHigh));
  return std::unique_ptr<Perturbation>(std::make_unique<ObservationNoise>(std, input.occurrence));
}

}  // namespace

extern const PerturbationEntry kObservationNoise;  // its line in list.cc
constinit const PerturbationEntry kObservationNoise = {
    .name = kName,
    .parameter = "std",
    .type = "number",
    .low = kLow,
    .high = kHigh,
    .description = "adds independent normal noise to every dimension of observations",
    .corrupts_datasets = true,
    .make = Make};

}  // namespace b4mrl
