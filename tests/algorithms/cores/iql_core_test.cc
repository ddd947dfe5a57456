#include "algorithms/cores/iql_core.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "tests/algorithms/random_batch.h"
#include "tests/algorithms/reference_file.h"

namespace b4mrl {
namespace {

struct Reference {
  explicit Reference(IqlActor kind)
      : actor(kind),
        file(kind == IqlActor::kGaussian ? "iql_gaussian.ref" : "iql_deterministic.ref") {}

  IqlOptions Options() const {
    IqlOptions options;
    options.actor = actor;
    SetReferenceSizes(file, &options);
    const std::vector<double> numbers = file.Vector<double>("cosine_updates_and_weight_max");
    options.cosine_updates = static_cast<int64_t>(numbers[0]);
    options.weight_max = numbers[1];
    return options;
  }

  // A core with the file's initial weights, for the target critics too.
  template <typename Scalar>
  IqlCore<Scalar> Core() const {
    Result<IqlCore<Scalar>> core = IqlCore<Scalar>::Create(Options());
    REQUIRE(core.ok());
    core->VisitArrays([&](const NamedArray<Scalar>& array) {
      if (!IsParameter(array.name)) return;
      std::string source = array.name;
      if (const size_t at = source.find("_target"); at != std::string::npos) source.erase(at, 7);
      file.Load("initial", NamedArray<Scalar>{source, array.shape, array.values});
    });
    return std::move(core).value();
  }

  template <typename Scalar>
  void CheckGradients(const std::string& step, double tolerance, IqlCore<Scalar>& core) const {
    core.VisitGradients([&](const NamedArray<Scalar>& array) {
      INFO(step << " " << array.name);
      CHECK(file.Difference(step + "/gradient", array) < tolerance);
    });
  }

  static bool IsParameter(const std::string& name) {
    return name.find("/layer") != std::string::npos || name == "log_std";
  }

  IqlActor actor;
  ReferenceFile file;
};

TEST_CASE("two IQL updates in double equal PyTorch's") {
  const Reference reference(GENERATE(IqlActor::kDeterministic, IqlActor::kGaussian));
  const ReferenceBatch<double> batch(reference.file);
  IqlCore<double> core = reference.Core<double>();
  // Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
  constexpr double kTolerance = 1e-9;
  for (const std::string step : {"step1", "step2"}) {
    const IqlMetrics metrics = core.Update(batch.Views());
    reference.CheckGradients(step, kTolerance, core);
    const std::vector<double> expected =
        reference.file.Vector<double>(step + "/value_actor_critic_losses_and_mean_weight");
    CHECK(metrics.value_loss == Approx(expected[0]).epsilon(kTolerance));
    CHECK(metrics.actor_loss == Approx(expected[1]).epsilon(kTolerance));
    CHECK(metrics.critic_loss == Approx(expected[2]).epsilon(kTolerance));
    CHECK(metrics.mean_weight == Approx(expected[3]).epsilon(kTolerance));
  }
  core.VisitArrays([&](const NamedArray<double>& array) {
    if (!Reference::IsParameter(array.name)) return;
    INFO(array.name);
    CHECK(reference.file.Difference("final", array) < kTolerance);
  });
}

TEST_CASE("IQL updates in float have PyTorch's gradients to float's precision") {
  const Reference reference(GENERATE(IqlActor::kDeterministic, IqlActor::kGaussian));
  const ReferenceBatch<float> batch(reference.file);
  IqlCore<float> core = reference.Core<float>();
  // Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
  for (const std::string step : {"step1", "step2"}) {
    core.Update(batch.Views());
    reference.CheckGradients(step, 1e-5, core);
  }
}

TEST_CASE("the actor's learning rate falls along half a cosine and stays at zero") {
  IqlOptions options;
  options.observation_size = 3;
  options.action_size = 2;
  options.hidden = {4};
  options.batch_max = 5;
  options.cosine_updates = 4;
  Result<IqlCore<double>> core = IqlCore<double>::Create(options);
  REQUIRE(core.ok());
  const RandomBatch<double> batch(3, 2, 5, 0);
  const double rate = options.actor_learning_rate;
  for (const double share : {1.0, 0.5 + std::sqrt(0.125), 0.5, 0.5 - std::sqrt(0.125), 0.0, 0.0}) {
    CHECK(core->actor_learning_rate() == Approx(share * rate).epsilon(0).margin(1e-18));
    core->Update(batch.Views());
  }
  options.cosine_updates = 0;
  Result<IqlCore<double>> constant = IqlCore<double>::Create(options);
  REQUIRE(constant.ok());
  constant->Update(batch.Views());
  CHECK(constant->actor_learning_rate() == rate);
}

TEST_CASE("a batch smaller than the largest sees nothing of the one before it") {
  IqlOptions options;
  options.observation_size = 3;
  options.action_size = 2;
  options.hidden = {8, 7};
  options.actor = GENERATE(IqlActor::kDeterministic, IqlActor::kGaussian);
  options.actor_learning_rate = options.critic_learning_rate = options.value_learning_rate = 0;
  options.tau = 0;
  options.batch_max = 9;
  Result<IqlCore<double>> used = IqlCore<double>::Create(options);
  options.batch_max = 4;
  Result<IqlCore<double>> fresh = IqlCore<double>::Create(options);
  REQUIRE(used.ok());
  REQUIRE(fresh.ok());
  const RandomBatch<double> large(3, 2, 9, 1), small(3, 2, 4, 2);
  used->Update(large.Views());
  const IqlMetrics got = used->Update(small.Views()), expected = fresh->Update(small.Views());
  CHECK(got.value_loss == Approx(expected.value_loss));
  CHECK(got.actor_loss == Approx(expected.actor_loss));
  CHECK(got.critic_loss == Approx(expected.critic_loss));
  CHECK(got.mean_weight == Approx(expected.mean_weight));
  CHECK(got.mean_value == Approx(expected.mean_value));
  CHECK(got.mean_target == Approx(expected.mean_target));
}

}  // namespace
}  // namespace b4mrl
