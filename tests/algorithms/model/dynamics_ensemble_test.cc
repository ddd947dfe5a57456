#include "algorithms/model/dynamics_ensemble.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "tests/algorithms/reference_file.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

DynamicsEnsembleOptions ReferenceOptions(const ReferenceFile& file) {
  DynamicsEnsembleOptions options;
  const std::vector<int> last = file.Get("initial/ensemble/layer4/bias").shape;
  options.members = last[0];
  options.elites = 2;
  options.observation_size = last[1] / 2 - 1;
  options.action_size = file.Get("batch/inputs").shape[1] - options.observation_size;
  options.batch_size = file.Get("batch/inputs").shape[0];
  options.hidden.clear();
  for (int i = 0; i < 4; ++i) {
    options.hidden.push_back(
        file.Get("initial/ensemble/layer" + std::to_string(i) + "/bias").shape[1]);
  }
  return options;
}

template <typename Scalar>
DynamicsEnsemble<Scalar> ReferenceEnsemble(const ReferenceFile& file) {
  Result<DynamicsEnsemble<Scalar>> ensemble =
      DynamicsEnsemble<Scalar>::Create(ReferenceOptions(file));
  REQUIRE(ensemble.ok());
  ensemble->VisitArrays([&](const NamedArray<Scalar>& array) {
    if (array.name.starts_with("ensemble/layer")) file.Load("initial", array);
  });
  return std::move(ensemble).value();
}

// The gradients with the decay term, which the optimiser adds: 2 decay[layer] weight.
template <typename Scalar>
std::map<std::string, std::vector<Scalar>> DecayGradients(DynamicsEnsemble<Scalar>& ensemble) {
  std::map<std::string, std::vector<Scalar>> gradients;
  ensemble.VisitArrays([&](const NamedArray<Scalar>& array) {
    if (!array.name.starts_with("ensemble/layer") || !array.name.ends_with("weight")) return;
    const double decay = ensemble.options().decay[array.name[14] - '0'];
    for (const Scalar weight : array.values) {
      gradients[array.name].push_back(static_cast<Scalar>(2 * decay * weight));
    }
  });
  return gradients;
}

// One update; checks loss and gradients.
template <typename Scalar>
void CheckStep(const ReferenceFile& file, const std::string& step, double tolerance,
               DynamicsEnsemble<Scalar>& ensemble) {
  const MatrixBuffer<Scalar> inputs = file.Matrix<Scalar>("batch/inputs");
  const MatrixBuffer<Scalar> targets = file.Matrix<Scalar>("batch/targets");
  auto decay_gradients = DecayGradients(ensemble);
  const double decay_loss = ensemble.DecayLoss();
  const double loss = ensemble.UpdateOnBatch(inputs.view(), targets.view()) + decay_loss;
  CHECK(loss == Approx(file.Get(step + "/loss").values[0]).epsilon(tolerance));
  ensemble.VisitGradients([&](const NamedArray<Scalar>& array) {
    INFO(step << " " << array.name);
    std::vector<Scalar> total(array.values.begin(), array.values.end());
    if (const auto decay = decay_gradients.find(array.name); decay != decay_gradients.end()) {
      for (size_t i = 0; i < total.size(); ++i) total[i] += decay->second[i];
    }
    CHECK(file.Difference(step + "/gradient", NamedArray<Scalar>{array.name, array.shape, total}) <
          tolerance);
  });
}

TEST_CASE("two ensemble updates in double equal PyTorch's") {
  const ReferenceFile file("ensemble.ref");
  DynamicsEnsemble<double> ensemble = ReferenceEnsemble<double>(file);
  // Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
  CheckStep(file, "step1", 1e-9, ensemble);
  CheckStep(file, "step2", 1e-9, ensemble);
  ensemble.VisitArrays([&](const NamedArray<double>& array) {
    const bool compared = array.name.starts_with("ensemble/layer") ||
                          array.name.starts_with("max_log") || array.name.starts_with("min_log");
    if (!compared) return;
    INFO(array.name);
    CHECK(file.Difference("final", array) < 1e-9);
  });
}

TEST_CASE("The penalty of a row is NaN where any member's prediction is") {
  DynamicsEnsembleOptions options;
  options.members = 3;
  options.elites = 2;
  options.observation_size = 4;
  options.action_size = 2;
  options.hidden = {8, 8, 8, 8};
  DynamicsEnsemble<float> ensemble = Take(DynamicsEnsemble<float>::Create(options));
  for (const size_t broken : {0, 1, 2}) {
    CAPTURE(broken);
    float* log_var = nullptr;  // the bias of the member's last log-variance
    ensemble.VisitArrays([&](const NamedArray<float>& array) {
      if (array.name != "ensemble/layer4/bias") return;
      log_var = &array.values[(broken + 1) * array.values.size() / 3 - 1];
    });
    REQUIRE(log_var != nullptr);
    const float before = *log_var;
    *log_var = std::numeric_limits<float>::quiet_NaN();
    MatrixBuffer<float> inputs(6, 1), noise(5, 1), outputs(5, 1);
    const int drawn[] = {static_cast<int>((broken + 1) % 3)};
    float penalty[] = {0};
    ensemble.Sample(inputs.view(), drawn, noise.view(), outputs.view(), penalty);
    CHECK(std::isnan(penalty[0]));
    *log_var = before;
  }
}

TEST_CASE("an ensemble update in float has PyTorch's gradients to float's precision") {
  const ReferenceFile file("ensemble.ref");
  DynamicsEnsemble<float> ensemble = ReferenceEnsemble<float>(file);
  // Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
  CheckStep(file, "step1", 1e-5, ensemble);
}

}  // namespace
}  // namespace b4mrl
