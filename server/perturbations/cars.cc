// cars=COUNT: how many other cars share the road with the ego. Preset: 15 (the paper's simulator;
// its real environment has 3).
#include <nlohmann/json.hpp>

#include "server/highway/settings.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class Cars final : public NumberPerturbation {
 public:
  using NumberPerturbation::NumberPerturbation;

  void OnOptions(Config& config, double count) const override {
    config["vehicles_count"] = static_cast<uint64_t>(count);
  }
};

constexpr Preset kPresets[] = {{"cars", "Highway", "cars", "15"}};

}  // namespace

extern const PerturbationEntry kCars;  // its line in list.cc
constinit const PerturbationEntry kCars = {
    .name = "cars",
    .parameter = "count",
    .type = "integer",
    .low = 0,
    .high = kMaxVehicles - 1,
    .takes_range = true,
    .description = "sets the number of other cars on the road",
    .needs = kOtherCars,
    .presets = kPresets,
    .make = MakeNumberPerturbation<Cars>};

}  // namespace b4mrl
