// cars=COUNT: how many other cars share the road with the ego. Preset: 15 (the paper's simulator;
// its real environment has 3).
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "server/highway/settings.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr const char* kName = "cars";
constexpr uint64_t kHigh = kMaxVehicles - 1;

class Cars final : public Perturbation {
 public:
  explicit Cars(uint64_t count) : count_(count) {}

  NamedArgument ToNamedArgument() const override { return {kName, fmt::format("{}", count_)}; }

  void OnOptions(Config& config) const override { config["vehicles_count"] = count_; }

 private:
  uint64_t count_;
};

bool HasCars(const EnvironmentSpec& spec) { return spec.name == "Highway"; }

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  B4MRL_ASSIGN_OR_RETURN(const uint64_t count, ParseUnsigned(kName, input.argument, 0, kHigh));
  return std::unique_ptr<Perturbation>(std::make_unique<Cars>(count));
}

}  // namespace

extern const PerturbationEntry kCars;  // its line in list.cc
constinit const PerturbationEntry kCars = {
    .name = kName,
    .parameter = "count",
    .type = "integer",
    .low = 0,
    .high = kHigh,
    .description = "sets the number of other cars on the road",
    .corrupts_datasets = false,
    .applies = HasCars,
    .make = Make};

}  // namespace b4mrl
