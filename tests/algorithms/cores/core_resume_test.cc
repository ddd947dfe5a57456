#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>

#include "algorithms/cores/iql_core.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"
#include "tests/algorithms/core_state.h"
#include "tests/algorithms/random_batch.h"

namespace b4mrl {
namespace {

template <typename Options>
Options Small(uint64_t seed) {
  Options options;
  options.observation_size = 5;
  options.action_size = 2;
  options.hidden = {16, 16};
  options.batch_max = 8;
  options.seed = seed;
  return options;
}

template <typename Core>
void UpdateTimes(Core& core, int first, int count) {
  for (int i = first; i < first + count; ++i) {
    const RandomBatch<float> batch(5, 2, 8, static_cast<uint64_t>(i));
    core.Update(batch.Views());
  }
}

TEMPLATE_TEST_CASE("a core resumed from its visited state goes on bit for bit", "",
                   (std::pair<SacCore<float>, SacOptions>), (std::pair<Td3Core<float>, Td3Options>),
                   (std::pair<IqlCore<float>, IqlOptions>)) {
  using Core = typename TestType::first_type;
  using Options = typename TestType::second_type;
  Result<Core> straight = Core::Create(Small<Options>(1));
  REQUIRE(straight.ok());
  UpdateTimes(*straight, 0, 5);
  const CoreState<float> saved = SaveState<float>(*straight);
  UpdateTimes(*straight, 5, 4);

  Result<Core> resumed = Core::Create(Small<Options>(1));
  REQUIRE(resumed.ok());
  CHECK_FALSE(SaveState<float>(*resumed) == saved);
  LoadState(saved, *resumed);
  UpdateTimes(*resumed, 5, 4);
  CHECK(SaveState<float>(*resumed) == SaveState<float>(*straight));
  CHECK(resumed->updates() == 9);

  Result<Core> other_seed = Core::Create(Small<Options>(2));
  REQUIRE(other_seed.ok());
  LoadState(saved, *other_seed);
  UpdateTimes(*other_seed, 5, 4);
  // An update of IQL draws no random numbers.
  CHECK((SaveState<float>(*other_seed) == SaveState<float>(*straight)) ==
        std::is_same_v<Core, IqlCore<float>>);
}

TEST_CASE("a Gaussian IQL core resumed from its visited state goes on bit for bit") {
  IqlOptions options = Small<IqlOptions>(1);
  options.actor = IqlActor::kGaussian;
  Result<IqlCore<float>> straight = IqlCore<float>::Create(options);
  Result<IqlCore<float>> resumed = IqlCore<float>::Create(options);
  REQUIRE(straight.ok());
  REQUIRE(resumed.ok());
  UpdateTimes(*straight, 0, 5);
  LoadState(SaveState<float>(*straight), *resumed);
  UpdateTimes(*straight, 5, 4);
  UpdateTimes(*resumed, 5, 4);
  CHECK(SaveState<float>(*resumed) == SaveState<float>(*straight));
}

TEST_CASE("the exported policy has the weights that the network trains") {
  Result<SacCore<float>> core = SacCore<float>::Create(Small<SacOptions>(3));
  REQUIRE(core.ok());
  UpdateTimes(*core, 0, 3);
  const PolicyWeights weights = core->Policy();
  int compared = 0;
  core->VisitArrays([&](const NamedArray<float>& array) {
    const auto equal = [&](const std::vector<float>& values, size_t offset) {
      ++compared;
      return std::equal(values.begin(), values.end(), array.values.begin() + offset);
    };
    if (array.name == "actor/layer0/weight") CHECK(equal(weights.hidden[0].weight, 0));
    if (array.name == "actor/layer1/bias") CHECK(equal(weights.hidden[1].bias, 0));
    if (array.name == "actor/layer2/weight") CHECK(equal(weights.mean.weight, 0));
    if (array.name == "actor/layer2/weight") CHECK(equal(weights.log_std->weight, 2 * 16));
    if (array.name == "actor/layer2/bias") CHECK(equal(weights.log_std->bias, 2));
  });
  CHECK(compared == 5);
  CHECK(FixedOrderPolicy::Create(weights).ok());
}

TEST_CASE("a NaN reward shows in the losses of the update that met it") {
  Result<SacCore<float>> sac = SacCore<float>::Create(Small<SacOptions>(4));
  Result<Td3Core<float>> td3 = Td3Core<float>::Create(Small<Td3Options>(4));
  Result<IqlCore<float>> iql = IqlCore<float>::Create(Small<IqlOptions>(4));
  REQUIRE(sac.ok());
  REQUIRE(td3.ok());
  REQUIRE(iql.ok());
  RandomBatch<float> batch(5, 2, 8, 0);
  batch.rewards[3] = std::numeric_limits<float>::quiet_NaN();
  CHECK(std::isnan(sac->Update(batch.Views()).critic_loss));
  CHECK(std::isnan(td3->Update(batch.Views()).critic_loss));
  CHECK(std::isnan(iql->Update(batch.Views()).critic_loss));
}

TEST_CASE("options outside their range are refused by name") {
  SacOptions sac = Small<SacOptions>(0);
  Td3Options td3 = Small<Td3Options>(0);
  IqlOptions iql = Small<IqlOptions>(0);
  std::string in_sac, in_td3, in_iql;
  const auto named = [&](const char* name) { in_sac = in_td3 = in_iql = name; };
  SECTION("learning rate") {
    sac.critic_learning_rate = td3.critic_learning_rate = iql.value_learning_rate = -1;
    named("critic_learning_rate");
    in_iql = "value_learning_rate";
  }
  SECTION("gamma") {
    sac.gamma = td3.gamma = iql.gamma = 1.5;
    named("gamma");
  }
  SECTION("NaN tau") {
    sac.tau = td3.tau = iql.tau = std::nan("");
    named("tau");
  }
  SECTION("no observation") {
    sac.observation_size = td3.observation_size = iql.observation_size = 0;
    named("observation_size");
  }
  SECTION("no hidden layer") {
    sac.hidden.clear();
    td3.hidden.clear();
    iql.hidden.clear();
    named("number of hidden layers");
  }
  SECTION("a huge width") {
    sac.hidden[0] = td3.hidden[0] = iql.hidden[0] = 1 << 30;
    named("hidden layer width");
  }
  SECTION("initial alpha, policy frequency, expectile") {
    sac.initial_alpha = 0;
    td3.policy_frequency = 0;
    iql.expectile = 1.1;
    in_sac = "initial_alpha";
    in_td3 = "policy_frequency";
    in_iql = "expectile";
  }
  const auto check = [](const Status& status, const std::string& name) {
    INFO(status.ToString());
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK(status.message().starts_with(name + " is "));
  };
  check(SacCore<float>::Create(sac).status(), in_sac);
  check(Td3Core<float>::Create(td3).status(), in_td3);
  check(IqlCore<float>::Create(iql).status(), in_iql);
}

}  // namespace
}  // namespace b4mrl
