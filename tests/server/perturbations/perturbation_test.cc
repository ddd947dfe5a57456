// The hooks and their random numbers, on simulators and on rows of a dataset.
#include "server/perturbations/perturbation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "server/environments/list.h"
#include "server/perturbations/list.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

EnvironmentSpec Spec() { return Take(DescribeEnvironment("HalfCheetah")); }

PerturbationSet Make(const std::string& text, PerturbationUse use = PerturbationUse::kDataset) {
  return Take(MakePerturbations(Take(ParseNamedArguments(text)), Spec(), use));
}

// What a set adds to an observation of zeros.
std::vector<double> NoiseOf(const PerturbationSet& set, const DrawContext& context) {
  std::vector<double> observation(17, 0.0);
  set.OnObservation(context, {}, observation);
  return observation;
}

double Mean(std::span<const double> x) {
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

double Correlation(std::span<const double> x, std::span<const double> y) {
  const double mx = Mean(x), my = Mean(y);
  double xy = 0, xx = 0, yy = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mx) * (y[i] - my);
    xx += (x[i] - mx) * (x[i] - mx);
    yy += (y[i] - my) * (y[i] - my);
  }
  return xy / std::sqrt(xx * yy);
}

constexpr uint64_t kRows = 20'000;
// Five standard errors of a correlation of kRows pairs.
const double kCorrelationMargin = 5 / std::sqrt(double{kRows});

// Column `dimension` of the noise at `context`, its minor running over kRows.
std::vector<double> Column(const PerturbationSet& set, DrawContext context, size_t dimension,
                           uint64_t first = 0) {
  std::vector<double> column(kRows);
  for (uint64_t i = 0; i < kRows; ++i) {
    context.minor = first + i;
    column[i] = NoiseOf(set, context)[dimension];
  }
  return column;
}

TEST_CASE("Observation noise has mean 0 and the given standard deviation in every dimension") {
  const PerturbationSet set = Make("obs-noise=0.05");
  std::vector<double> sum(17, 0.0), squares(17, 0.0);
  for (uint64_t row = 0; row < kRows; ++row) {
    const auto noise = NoiseOf(set, {DrawContext::Kind::kDataset, 1, 0, row});
    for (size_t i = 0; i < 17; ++i) {
      sum[i] += noise[i];
      squares[i] += noise[i] * noise[i];
    }
  }
  for (size_t i = 0; i < 17; ++i) {
    // Five standard errors: 0.05 / sqrt(n) for the mean, sqrt(2 / n) for the relative variance.
    CHECK(std::abs(sum[i] / kRows) < 5 * 0.05 / std::sqrt(double{kRows}));
    CHECK(squares[i] / kRows == Approx(0.05 * 0.05).epsilon(5 * std::sqrt(2.0 / kRows)));
  }
}

TEST_CASE("Noise is independent over dimensions, steps, episodes, lanes and kinds of use") {
  const PerturbationSet set = Make("obs-noise=1");
  const DrawContext base = {DrawContext::Kind::kEpisode, 1, 0, 0};
  const std::vector<double> column = Column(set, base, 4);
  const auto check = [&](const std::vector<double>& other) {
    CHECK(std::abs(Correlation(column, other)) < kCorrelationMargin);
  };
  check(Column(set, base, 5));
  check(Column(set, base, 4, 1));  // the next step
  for (const DrawContext::Kind kind : {DrawContext::Kind::kQuery, DrawContext::Kind::kDataset,
                                       DrawContext::Kind::kDatasetLastRow}) {
    DrawContext other = base;
    other.kind = kind;
    check(Column(set, other, 4));
  }
  check(Column(set, {DrawContext::Kind::kEpisode, 2, 0, 0}, 4));  // the next lane
  check(Column(set, {DrawContext::Kind::kEpisode, 1, 1, 0}, 4));  // the next episode
}

TEST_CASE("Noise of a seed is what it was when the committed results were trained with it") {
  const PerturbationSet set = Make("obs-noise=1");
  const auto noise_of = [&](DrawContext::Kind kind) { return NoiseOf(set, {kind, 1, 2, 3}); };
  // Recorded, to the digits that are written here.
  CHECK(noise_of(DrawContext::Kind::kEpisode)[0] == Approx(-1.9135862882).epsilon(1e-9));
  CHECK(noise_of(DrawContext::Kind::kEpisode)[16] == Approx(-0.5324937672).epsilon(1e-9));
  CHECK(noise_of(DrawContext::Kind::kQuery)[0] == Approx(-1.9416388119).epsilon(1e-9));
  CHECK(noise_of(DrawContext::Kind::kDataset)[0] == Approx(-1.8637378901).epsilon(1e-9));
  CHECK(noise_of(DrawContext::Kind::kDatasetLastRow)[0] == Approx(0.1227462679).epsilon(1e-9));
}

TEST_CASE("Two levels scale the same noise") {
  const DrawContext context = {DrawContext::Kind::kDataset, 3, 0, 12};
  const auto low = NoiseOf(Make("obs-noise-low"), context);
  const auto high = NoiseOf(Make("obs-noise-high"), context);
  for (size_t i = 0; i < 17; ++i) {
    CHECK(high[i] == Approx(5 * low[i]).epsilon(1e-12));  // 0.05 / 0.01; rounding
  }
}

TEST_CASE("Noise of a row can be drawn in any order, also for later episodes of long streams") {
  const PerturbationSet set = Make("obs-noise=1");
  const DrawContext far = {DrawContext::Kind::kDataset, 1, 0, 99'999'999};
  const auto first = NoiseOf(set, far);
  NoiseOf(set, {DrawContext::Kind::kDataset, 1, 0, 5});
  REQUIRE(NoiseOf(set, far) == first);
  REQUIRE(NoiseOf(Make("obs-noise=1"), far) == first);
}

TEST_CASE("Adding a perturbation changes no other's draws") {
  const DrawContext context = {DrawContext::Kind::kEpisode, 3, 1, 12};
  const auto use = PerturbationUse::kSimulator;
  const auto alone = NoiseOf(Make("obs-noise=0.1", use), context);
  REQUIRE(NoiseOf(Make("gravity,obs-noise=0.1,friction=2", use), context) == alone);
  auto hidden = alone;
  hidden[9] = 0;
  REQUIRE(NoiseOf(Make("obs-noise=0.1,hidden=9", use), context) == hidden);
  // A second noise adds its own draws to the first's.
  const auto twice = NoiseOf(Make("obs-noise=0.1,obs-noise=0.1", use), context);
  for (size_t i = 0; i < 17; ++i) REQUIRE(twice[i] != 2 * alone[i]);
}

TEST_CASE("Two noises in one set are independent") {
  const PerturbationSet one = Make("obs-noise=1");
  const PerturbationSet two = Make("obs-noise=1,obs-noise=1");
  const DrawContext context = {DrawContext::Kind::kDataset, 1, 0, 0};
  const std::vector<double> first = Column(one, context, 0);
  std::vector<double> second = Column(two, context, 0);
  for (size_t i = 0; i < second.size(); ++i) second[i] -= first[i];
  CHECK(std::abs(Correlation(first, second)) < kCorrelationMargin);
  double squares = 0;
  for (const double x : second) squares += x * x;
  CHECK(squares / kRows == Approx(1).epsilon(5 * std::sqrt(2.0 / kRows)));  // five standard errors
}

TEST_CASE("Hidden dimensions are 0, in whichever order perturbations are written") {
  const DrawContext context = {DrawContext::Kind::kDataset, 1, 0, 0};
  for (const char* written : {"obs-noise=1,hidden=9", "hidden=9,obs-noise=1"}) {
    const PerturbationSet set = Make(written);
    CHECK(NoiseOf(set, context)[9] == 0);
    CHECK(NoiseOf(set, context)[8] != 0);
    CHECK(FormatNamedArguments(set.items()) == "obs-noise=1,hidden=9");
  }
}

TEST_CASE("Numbers that are not finite pass through noise and vanish only where hidden") {
  std::vector<double> observation(17, std::nan(""));
  observation[3] = std::numeric_limits<double>::infinity();
  Make("obs-noise=1,hidden=9").OnObservation({}, {}, observation);
  REQUIRE(std::isnan(observation[0]));
  REQUIRE(std::isinf(observation[3]));
  REQUIRE(observation[9] == 0);
}

TEST_CASE("A simulator hides and disturbs what it reports, not what it simulates") {
  TestLane clean(OpenHalfCheetah());
  TestLane perturbed(OpenHalfCheetah("obs-noise=0.1,hidden=v-root-z"));
  clean.Reset(5);
  perturbed.Reset(5);
  for (uint64_t k = 0; k < 50; ++k) {
    REQUIRE(perturbed.observation()[9] == 0);
    REQUIRE(perturbed.observation()[0] != clean.observation()[0]);
    REQUIRE(perturbed.state() == clean.state());
    REQUIRE(perturbed.header().reward == clean.header().reward);
    clean.StepRandomly(k);
    perturbed.StepRandomly(k);
  }
}

TEST_CASE("A lane's noise is that of its seed, episode and step") {
  const PerturbationSet set = Make("obs-noise=0.1", PerturbationUse::kSimulator);
  TestLane clean(OpenHalfCheetah());
  TestLane noisy(OpenHalfCheetah("obs-noise=0.1"));
  for (const auto lane : {&clean, &noisy}) {
    lane->Reset(5);
    lane->Reset();
    for (uint64_t k = 0; k < 3; ++k) lane->StepRandomly(k);
  }
  std::vector<double> expected = clean.observation();
  set.OnObservation({DrawContext::Kind::kEpisode, 5, 1, 3}, {}, expected);
  REQUIRE(noisy.observation() == expected);
}

// Hands on the action of the step before, and adds to a setting: exercises the hooks with state.
class Delay final : public Perturbation {
 public:
  NamedArgument ToNamedArgument() const override { return {"test-delay", "1"}; }
  void OnOptions(Config& config, double /*number*/) const override {
    config["max_episode_steps"] = 4;
  }
  size_t state_size(const EnvironmentSpec& spec) const override { return spec.action.size(); }
  void OnAction(const DrawContext& /*context*/, std::span<double> state,
                std::span<double> action) const override {
    std::swap_ranges(state.begin(), state.end(), action.begin());
  }
};

TEST_CASE("A perturbation keeps its state in the lane's record and may change settings") {
  const auto build = [](int delays) {
    std::vector<std::unique_ptr<Perturbation>> members;
    for (int i = 0; i < delays; ++i) members.push_back(std::make_unique<Delay>());
    return Take(Simulator::Build("HalfCheetah", Config::object(),
                                 PerturbationSet(Spec(), std::move(members))));
  };
  REQUIRE(build(1)->CheckQueryable().code() == StatusCode::kUnsupported);
  REQUIRE(build(0)->CheckQueryable().ok());
  TestLane delayed(build(2), AutoresetMode::kNextStep);
  TestLane plain(OpenHalfCheetah());
  REQUIRE(delayed.stepper().spec().max_episode_steps == 4);
  REQUIRE(delayed.stepper().layout().perturbation_state_size == 12);
  delayed.Reset();
  plain.Reset();
  const std::vector<double> none(6, 0.0);
  for (uint64_t k = 0; k < 4; ++k) {
    plain.Step(k < 2 ? none : RandomAction(6, 1, k - 2));
    delayed.StepRandomly(k);
    REQUIRE(delayed.state() == plain.state());
  }
  REQUIRE(delayed.header().cause == Cause::kLimit);
  delayed.StepRandomly(4);  // resets, and forgets the delayed actions
  REQUIRE(ToVector(delayed.record().perturbation_state()) == std::vector<double>(12, 0.0));
}

// Shows each observation one step late, the first one twice; and adds what it has in mind to
// rewards: exercises lane state in observations, and the reward's hook.
class LateObservation final : public Perturbation {
 public:
  NamedArgument ToNamedArgument() const override { return {"test-late-observation", "1"}; }
  size_t state_size(const EnvironmentSpec& spec) const override { return spec.observation.size(); }
  void OnReward(const DrawContext& context, std::span<double> state,
                double& reward) const override {
    reward += 100 * static_cast<double>(context.minor) + state[0];
  }
  void OnObservation(const DrawContext& context, std::span<double> state,
                     std::span<double> observation) const override {
    if (context.minor == 0) std::ranges::copy(observation, state.begin());
    std::ranges::swap_ranges(state, observation);
  }
};

TEST_CASE("A perturbation may delay observations by lane state, and change rewards") {
  std::vector<std::unique_ptr<Perturbation>> members;
  members.push_back(std::make_unique<LateObservation>());
  const auto simulator = Take(Simulator::Build("HalfCheetah", Config::object(),
                                               PerturbationSet(Spec(), std::move(members))));
  CHECK(simulator->CheckQueryable().code() == StatusCode::kUnsupported);
  TestLane late(simulator, AutoresetMode::kSameStep), plain(OpenHalfCheetah());
  late.Reset(5);
  plain.Reset(5);
  REQUIRE(late.observation() == plain.observation());
  double episode_return = 0;
  for (uint64_t k = 0; k < 20; ++k) {
    const std::vector<double> before = plain.observation();
    late.StepRandomly(k);
    plain.StepRandomly(k);
    CAPTURE(k);
    REQUIRE(late.observation() == before);
    const double reward = plain.header().reward + (100 * static_cast<double>(k + 1) + before[0]);
    REQUIRE(late.header().reward == reward);
    episode_return += reward;
    REQUIRE(late.header().episode_return == episode_return);
  }
}

class RowReward final : public Perturbation {
 public:
  NamedArgument ToNamedArgument() const override { return {"test-row-reward", "1"}; }
  void OnReward(const DrawContext& context, std::span<double> /*state*/,
                double& reward) const override {
    reward += static_cast<double>(context.minor);
  }
};

TEST_CASE("The reward of a query's row is perturbed by its place") {
  std::vector<std::unique_ptr<Perturbation>> members;
  members.push_back(std::make_unique<RowReward>());
  const auto simulator = Take(Simulator::Build("HalfCheetah", Config::object(),
                                               PerturbationSet(Spec(), std::move(members))));
  const auto plain = OpenHalfCheetah();
  const std::vector<double> observation = RandomAction(17, 2, 0), action = RandomAction(6, 2, 1);
  std::vector<double> next(17);
  const double reward = plain->Query(*Take(plain->Borrow()), {}, observation, action, next).reward;
  const QueryResult result =
      simulator->Query(*Take(simulator->Borrow()), {1, 2, 3}, observation, action, next);
  CHECK(result.reward == reward + 3);
}

}  // namespace
}  // namespace b4mrl
