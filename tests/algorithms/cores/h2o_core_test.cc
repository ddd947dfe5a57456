// H2O's whole update against PyTorch, and the promises of a core.
#include "algorithms/cores/h2o_core.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/algorithms/core_state.h"
#include "tests/algorithms/random_batch.h"
#include "tests/algorithms/reference_file.h"

namespace b4mrl {
namespace {

H2oOptions ReferenceOptions(const ReferenceFile& file) {
  H2oOptions options;
  SetReferenceSizes(file, &options);
  options.discriminator_batch_max = file.Get("discriminator_batch/observations").shape[0];
  options.gap_samples = static_cast<int>(file.Get("rows").values[2]);
  options.gap_noise = file.Vector<double>("gap_deviation");
  options.policy.log_std_min = -5;  // LOG_STD_RANGE of dump_pytorch.py
  options.policy.log_std_max = 0.5;
  return options;
}

// A core with the file's initial weights, for the target critics too.
template <typename Scalar>
H2oCore<Scalar> ReferenceCore(const ReferenceFile& file) {
  Result<H2oCore<Scalar>> core = H2oCore<Scalar>::Create(ReferenceOptions(file));
  REQUIRE(core.ok());
  core->VisitArrays([&](const NamedArray<Scalar>& array) {
    std::string source = array.name;
    if (source.starts_with("critic_target/")) source.replace(0, 13, "critic");
    const bool weights = source.find("/layer") != std::string::npos;
    if (!weights && source != "actor/log_std_scale") return;
    file.Load("initial", NamedArray<Scalar>{source, array.shape, array.values});
  });
  return std::move(core).value();
}

template <typename Scalar>
H2oMetrics ReferenceStep(const ReferenceFile& file, const std::string& step,
                         H2oCore<Scalar>& core) {
  const ReferenceBatch<Scalar> rows(file), discriminator_rows(file, "discriminator_batch");
  const std::vector<double> real_rows = file.Vector<double>("rows");
  const auto noise = [&](const std::string& name) { return file.Matrix<Scalar>(step + name); };
  const MatrixBuffer<Scalar> discriminators = noise("/discriminator_noise");
  const MatrixBuffer<Scalar> gap = noise("/gap_noise");
  const MatrixBuffer<Scalar> actions = file.ActionNoise<Scalar>(step);
  return core.Update({rows.Views(), static_cast<int>(real_rows[0])},
                     {discriminator_rows.Views(), static_cast<int>(real_rows[1])},
                     {discriminators.view(), gap.view(), actions.view()});
}

std::vector<double> Numbers(const H2oMetrics& metrics) {
  return {metrics.discriminators.state_action_loss,
          metrics.discriminators.transition_loss,
          metrics.sac.critic_loss,
          metrics.gap_penalty,
          metrics.sac.actor_loss,
          metrics.sac.alpha_loss,
          metrics.mean_weight,
          metrics.mean_gap};
}

H2oOptions Small(uint64_t seed) {
  H2oOptions options;
  options.observation_size = 5;
  options.action_size = 2;
  options.hidden = {16, 16};
  options.batch_max = 8;
  options.discriminator_batch_max = 10;
  options.gap_samples = 3;
  options.gap_noise.assign(5, 0.3);
  options.seed = seed;
  return options;
}

H2oMetrics UpdateOnce(H2oCore<float>& core, int number) {
  const RandomBatch<float> batch(5, 2, 8, static_cast<uint64_t>(2 * number));
  const RandomBatch<float> discriminators(5, 2, 10, static_cast<uint64_t>(2 * number + 1));
  return core.Update({batch.Views(), 5}, {discriminators.Views(), 6});
}

void UpdateTimes(H2oCore<float>& core, int first, int count) {
  for (int i = first; i < first + count; ++i) UpdateOnce(core, i);
}

H2oCore<float> SmallCore(uint64_t seed) {
  Result<H2oCore<float>> core = H2oCore<float>::Create(Small(seed));
  REQUIRE(core.ok());
  return std::move(core).value();
}

}  // namespace

TEST_CASE("two H2O updates in double equal PyTorch's") {
  const ReferenceFile file("h2o.ref");
  H2oCore<double> core = ReferenceCore<double>(file);
  // Both compute in double; 1e-9 leaves room for the order of sums, not for a wrong term.
  constexpr double kTolerance = 1e-9;
  for (const std::string step : {"step1", "step2"}) {
    const std::vector<double> numbers = Numbers(ReferenceStep(file, step, core));
    core.VisitGradients([&](const NamedArray<double>& array) {
      INFO(step << " " << array.name);
      CHECK(file.Difference(step + "/gradient", array) < kTolerance);
    });
    const std::vector<double> expected = file.Vector<double>(step + "/losses");
    REQUIRE(expected.size() == numbers.size());
    for (size_t i = 0; i < numbers.size(); ++i) {
      INFO(step << " number " << i);
      CHECK(numbers[i] == Approx(expected[i]).epsilon(kTolerance));
    }
  }
  core.VisitArrays([&](const NamedArray<double>& array) {
    INFO(array.name);
    if (array.name.find("/adam") != std::string::npos) return;
    CHECK(file.Difference("final", array) < kTolerance);
  });
}

TEST_CASE("an H2O update in float has PyTorch's gradients to float's precision") {
  const ReferenceFile file("h2o.ref");
  H2oCore<float> core = ReferenceCore<float>(file);
  ReferenceStep(file, "step1", core);
  core.VisitGradients([&](const NamedArray<float>& array) {
    INFO(array.name);
    // Sums of at most a few dozen float terms: about a hundred roundings of 6e-8.
    CHECK(file.Difference("step1/gradient", array) < 1e-5);
  });
}

TEST_CASE("H2O resumed from its visited state goes on bit for bit") {
  H2oCore<float> straight = SmallCore(1);
  UpdateTimes(straight, 0, 5);
  const CoreState<float> saved = SaveState<float>(straight);
  UpdateTimes(straight, 5, 4);

  H2oCore<float> resumed = SmallCore(1);
  CHECK_FALSE(SaveState<float>(resumed) == saved);
  LoadState(saved, resumed);
  UpdateTimes(resumed, 5, 4);
  CHECK(SaveState<float>(resumed) == SaveState<float>(straight));
  CHECK(resumed.updates() == 9);

  H2oCore<float> other_seed = SmallCore(2);
  LoadState(saved, other_seed);
  UpdateTimes(other_seed, 5, 4);
  CHECK_FALSE(SaveState<float>(other_seed) == SaveState<float>(straight));
}

TEST_CASE("a policy file's log_std has H2O's learned scale and offset in its head") {
  H2oCore<float> core = SmallCore(3);
  UpdateTimes(core, 0, 3);
  float m = 0, b = 0;
  std::vector<float> head, bias;
  core.VisitArrays([&](const NamedArray<float>& array) {
    if (array.name == "actor/log_std_scale") {
      array.values[0] = m = 1.5f;
      array.values[1] = b = -0.7f;
    }
    if (array.name == "actor/layer2/weight") head.assign(array.values.begin(), array.values.end());
    if (array.name == "actor/layer2/bias") bias.assign(array.values.begin(), array.values.end());
  });
  const PolicyWeights policy = core.Policy();
  REQUIRE(policy.log_std);
  for (size_t i = 0; i < policy.mean.weight.size(); ++i) {
    CHECK(policy.mean.weight[i] == head[i]);
    CHECK(policy.log_std->weight[i] == m * head[policy.mean.weight.size() + i]);
  }
  for (size_t i = 0; i < 2; ++i) CHECK(policy.log_std->bias[i] == m * bias[2 + i] + b);
}

TEST_CASE("a fresh H2O policy is cautious: small means, deviations near exp(-1)") {
  // Output layers start within 0.01 sqrt(6 / (inputs + outputs)), biases at 0, m = 1 and b = -1.
  const PolicyWeights policy = SmallCore(4).Policy();
  const float bound = 0.01f * std::sqrt(6.0f / (16 + 4));
  for (const float weight : policy.mean.weight) CHECK(std::abs(weight) <= bound);
  for (const float weight : policy.log_std->weight) CHECK(std::abs(weight) <= bound);
  CHECK(policy.mean.bias == std::vector<float>{0, 0});
  CHECK(policy.log_std->bias == std::vector<float>{-1, -1});
}

TEST_CASE("the gap's noise is the data's deviation, or that of the authors' padded array") {
  const std::vector<double> data = {3, 5, -2, 4};
  const double mean = 2.5, std = std::sqrt((0.25 + 6.25 + 20.25 + 2.25) / 4);
  CHECK(GapNoise({&mean, 1}, {&std, 1}, GapNoiseStd::kData, 2)[0] == Approx(2 * (std + 0.001)));

  std::vector<double> padded = data;
  padded.resize(11 * data.size(), 0.0);
  double sum = 0, square_sum = 0;
  for (const double value : padded) {
    sum += value;
    square_sum += value * value;
  }
  const double n = static_cast<double>(padded.size());
  const double expected = std::sqrt(square_sum / n - sum / n * sum / n) + 0.001;
  CHECK(GapNoise({&mean, 1}, {&std, 1}, GapNoiseStd::kPadded, 1)[0] == Approx(expected));
}

TEST_CASE("a NaN reward shows in the losses of the H2O update that met it") {
  H2oCore<float> core = SmallCore(5);
  RandomBatch<float> batch(5, 2, 8, 0);
  const RandomBatch<float> discriminators(5, 2, 10, 1);
  batch.rewards[6] = std::numeric_limits<float>::quiet_NaN();
  const H2oMetrics metrics = core.Update({batch.Views(), 5}, {discriminators.Views(), 6});
  CHECK(std::isnan(metrics.sac.critic_loss));
}

TEST_CASE("H2O's options outside their range are refused by name") {
  H2oOptions options = Small(0);
  std::string name;
  SECTION("samples") {
    options.gap_samples = 0;
    name = "gap_samples";
  }
  SECTION("a deviation too few") {
    options.gap_noise.pop_back();
    name = "gap_noise";
  }
  SECTION("NaN deviation") {
    options.gap_noise[2] = std::nan("");
    name = "gap_noise";
  }
  SECTION("ratio") {
    options.ratio_min = 0;
    name = "ratio_min";
  }
  SECTION("discriminators' rate") {
    options.discriminator_learning_rate = -1;
    name = "learning_rate";
  }
  SECTION("an option of SAC") {
    options.tau = 2;
    name = "tau";
  }
  const Status status = H2oCore<float>::Create(options).status();
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK(status.message().find(name) != std::string::npos);
}

}  // namespace b4mrl
