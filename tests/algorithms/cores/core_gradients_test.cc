// Finite differences through whole updates. With all learning rates zero an update changes no
// parameter, so its losses are functions of the parameters, and its gradients can be checked
// against them. Every noise is held fixed.
#include <catch2/catch.hpp>
#include <vector>

#include "algorithms/cores/iql_core.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"
#include "algorithms/model/dynamics_ensemble.h"
#include "tests/algorithms/core_state.h"
#include "tests/algorithms/finite_differences.h"
#include "tests/algorithms/random_batch.h"

namespace b4mrl {
namespace {

constexpr int kObservations = 5;
constexpr int kActions = 2;
constexpr int kBatch = 7;

MatrixBuffer<double> Normals(int rows, uint64_t stream, int columns = kBatch) {
  MatrixBuffer<double> matrix(rows, columns);
  Rng rng(11, "core-gradients-test", stream);
  rng.FillNormal(matrix.values());
  return matrix;
}

// Small, of one to three hidden layers, and with rates of 0, so that an update leaves the weights
// as they are.
template <typename Options>
Options FrozenOptions() {
  Options options;
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.hidden = GENERATE(values<std::vector<int>>({{9}, {9, 8}, {9, 8, 7}}));
  options.batch_max = kBatch;
  options.actor_learning_rate = options.critic_learning_rate = 0;
  options.tau = 0;
  return options;
}

TEST_CASE("SAC's losses have the gradients of their finite differences") {
  auto options = FrozenOptions<SacOptions>();
  options.alpha_learning_rate = 0;
  options.initial_alpha = 0.4;
  options.policy.form = GENERATE(LogProbForm::kEpsilon, LogProbForm::kExact);
  Result<SacCore<double>> core = SacCore<double>::Create(options);
  REQUIRE(core.ok());
  const RandomBatch<double> batch(kObservations, kActions, kBatch, 1);
  const MatrixBuffer<double> noise = Normals(kActions, 0, 2 * kBatch);
  const auto update = [&] { return core->Update(batch.Views(), noise.view()); };
  CheckGradientsOf("critic/", *core, [&] { return update().critic_loss; });
  CheckGradientsOf("actor/", *core, [&] { return update().actor_loss; });
  CheckGradientsOf("log_alpha", *core, [&] { return update().alpha_loss; });
}

TEST_CASE("TD3's and TD3-BC's losses have the gradients of their finite differences") {
  auto options = FrozenOptions<Td3Options>();
  options.policy_frequency = 1;
  if (GENERATE(false, true)) options.bc_alpha = 2.5;
  Result<Td3Core<double>> core = Td3Core<double>::Create(options);
  REQUIRE(core.ok());
  const RandomBatch<double> batch(kObservations, kActions, kBatch, 2);
  const MatrixBuffer<double> noise = Normals(kActions, 2);
  const auto update = [&] { return core->Update(batch.Views(), noise.view()); };
  CheckGradientsOf("critic/", *core, [&] { return update().critic_loss; });
  const double lambda = update().lambda.value_or(1);
  CheckGradientsOf("actor/", *core, [&] {
    // Lambda is a constant of the loss: replace the perturbed one by the unperturbed.
    const Td3Metrics metrics = update();
    const double bc_loss = metrics.bc_loss.value_or(0);
    const double mean_q = (bc_loss - metrics.actor_loss) / metrics.lambda.value_or(1);
    return -lambda * mean_q + bc_loss;
  });
}

TEST_CASE("IQL's losses have the gradients of their finite differences") {
  auto options = FrozenOptions<IqlOptions>();
  options.value_learning_rate = 0;
  options.actor = GENERATE(IqlActor::kDeterministic, IqlActor::kGaussian);
  Result<IqlCore<double>> core = IqlCore<double>::Create(options);
  REQUIRE(core.ok());
  const RandomBatch<double> batch(kObservations, kActions, kBatch, 3);
  const auto update = [&] { return core->Update(batch.Views()); };
  CheckGradientsOf("value/", *core, [&] { return update().value_loss; });
  CheckGradientsOf("actor/", *core, [&] { return update().actor_loss; });
  CheckGradientsOf("critic/", *core, [&] { return update().critic_loss; });
  if (options.actor == IqlActor::kDeterministic) return;
  CheckGradientsOf("log_std", *core, [&] { return update().actor_loss; });
}

TEST_CASE("the ensemble's loss has the gradients of its finite differences") {
  DynamicsEnsembleOptions options;
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.members = 2;
  options.elites = 1;
  options.hidden = {6, 7};
  options.decay = {0.1, 0.2, 0.3};
  options.batch_size = kBatch;
  options.learning_rate = 0;
  options.initialization =
      GENERATE(Initialization::kTorchUniform, Initialization::kTruncatedNormal);
  Result<DynamicsEnsemble<double>> ensemble = DynamicsEnsemble<double>::Create(options);
  REQUIRE(ensemble.ok());
  const MatrixBuffer<double> inputs = Normals(kObservations + kActions, 3);
  const MatrixBuffer<double> targets = Normals(kObservations + 1, 4);
  const auto loss = [&] { return ensemble->UpdateOnBatch(inputs.view(), targets.view()); };
  CheckGradientsOf("ensemble/", *ensemble, loss);
  CheckGradientsOf("max_log_var", *ensemble, loss);
  CheckGradientsOf("min_log_var", *ensemble, loss);
}

TEST_CASE("the ensemble's decay term is what the optimiser adds") {
  DynamicsEnsembleOptions options;
  options.observation_size = kObservations;
  options.action_size = kActions;
  options.members = 1;
  options.elites = 1;
  options.hidden = {4};
  options.decay = {0.5, 0.25};
  options.decay_scale = 0.5;
  Result<DynamicsEnsemble<double>> ensemble = DynamicsEnsemble<double>::Create(options);
  REQUIRE(ensemble.ok());
  double expected = 0;
  ensemble->VisitArrays([&](const NamedArray<double>& array) {
    const bool first = array.name == "ensemble/layer0/weight";
    if (!first && array.name != "ensemble/layer1/weight") return;
    for (const double w : array.values) expected += 0.5 * (first ? 0.5 : 0.25) * w * w;
  });
  CHECK(ensemble->DecayLoss() == Approx(expected).epsilon(1e-12));
}

}  // namespace
}  // namespace b4mrl
