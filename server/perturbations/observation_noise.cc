// obs-noise=STD: adds STD times an independent standard normal to every dimension of an
// observation. The normals depend on the row's DrawContext and not on STD: another STD scales the
// same noise matrix.
//
// Where an observation has rows (Highway's vehicles, already normalised), flags (presence) get no
// noise, and neither do rows of zeros, which stand for vehicles that are not there.
#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

class ObservationNoise final : public NumberPerturbation {
 public:
  ObservationNoise(const PerturbationInput& input, const NumberArgument& std)
      : NumberPerturbation(input, std) {
    const SpaceSpec& space = input.spec->observation;
    skips_empty_rows_ = space.shape.size() == 2;
    row_size_ = skips_empty_rows_ ? space.shape[1] : space.size();
    for (const DimensionSpec& dimension : space.dimensions) flags_.push_back(dimension.flag);
  }

  void OnObservation(const DrawContext& context, std::span<double> /*state*/,
                     std::span<double> observation) const override {
    Rng rng = RowRng(context, observation.size());
    for (size_t row = 0; row + row_size_ <= observation.size() && row_size_ > 0; row += row_size_) {
      AddTo(observation.subspan(row, row_size_), std::span(flags_).subspan(row, row_size_), &rng);
    }
  }

 private:
  void AddTo(std::span<double> row, std::span<const uint8_t> flags, Rng* rng) const {
    const bool empty =
        skips_empty_rows_ && std::ranges::all_of(row, [](double value) { return value == 0; });
    for (size_t i = 0; i < row.size(); ++i) {
      const double normal = rng->Normal();  // drawn for every dimension: fixed stream positions
      if (!empty && flags[i] == 0) row[i] += fixed_number() * normal;
    }
  }

  size_t row_size_;
  bool skips_empty_rows_;
  std::vector<uint8_t> flags_;  // 1 for a dimension that is a flag, else 0
};

constexpr Preset kPresets[] = {{"obs-noise-low", "HalfCheetah", "obs-noise", "0.01"},
                               {"obs-noise-low", "Hopper", "obs-noise", "0.001"},
                               {"obs-noise-low", "Walker2d", "obs-noise", "0.01"},
                               {"obs-noise-low", "Highway", "obs-noise", "0.5"},
                               {"obs-noise-high", "HalfCheetah", "obs-noise", "0.05"},
                               {"obs-noise-high", "Hopper", "obs-noise", "0.02"},
                               {"obs-noise-high", "Walker2d", "obs-noise", "0.03"},
                               {"obs-noise-high", "Highway", "obs-noise", "1"}};

}  // namespace

extern const PerturbationEntry kObservationNoise;  // its line in list.cc
constinit const PerturbationEntry kObservationNoise = {
    .name = "obs-noise",
    .parameter = "std",
    .type = "number",
    .low = 0,
    .high = 1e6,
    .description =
        "adds independent normal noise to every dimension of observations but flags and empty rows",
    .corrupts_datasets = true,
    .draws_for_datasets = true,
    .presets = kPresets,
    .make = MakeNumberPerturbation<ObservationNoise>};

}  // namespace b4mrl
