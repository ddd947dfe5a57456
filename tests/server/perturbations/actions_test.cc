// Perturbations of actions: noise, delay, and the two together, on rows of numbers and on lanes.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "server/environments/list.h"
#include "server/perturbations/list.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr size_t kActions = 6;  // of HalfCheetah
constexpr uint64_t kRows = 20'000;
constexpr auto kEpisode = DrawContext::Kind::kEpisode;
constexpr auto kQuery = DrawContext::Kind::kQuery;

// HalfCheetah with actions that may be of any size, so that clipping does not bend the statistics.
EnvironmentSpec Unbounded() {
  EnvironmentSpec spec = Take(DescribeEnvironment("HalfCheetah"));
  for (DimensionSpec& dimension : spec.action.dimensions) {
    dimension.low = -1e9;
    dimension.high = 1e9;
  }
  return spec;
}

PerturbationSet Make(const std::string& text, const EnvironmentSpec& spec = Unbounded()) {
  return Take(
      MakePerturbations(Take(ParseNamedArguments(text)), spec, PerturbationUse::kSimulator));
}

std::vector<double> ActionOf(const PerturbationSet& set, const DrawContext& context,
                             std::vector<double> action = std::vector<double>(kActions, 0.0)) {
  set.OnAction(context, {}, action);
  return action;
}

// Component `index` of the noise at `context`, its minor (the step) running over kRows.
std::vector<double> Column(const PerturbationSet& set, DrawContext context, size_t index,
                           uint64_t first = 0) {
  std::vector<double> column(kRows);
  for (uint64_t i = 0; i < kRows; ++i) {
    context.minor = first + i;
    column[i] = ActionOf(set, context)[index];
  }
  return column;
}

double Mean(std::span<const double> x) {
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

double Variance(std::span<const double> x) {
  const double mean = Mean(x);
  double sum = 0;
  for (const double value : x) sum += (value - mean) * (value - mean);
  return sum / static_cast<double>(x.size());
}

double Correlation(std::span<const double> x, std::span<const double> y) {
  const double mx = Mean(x), my = Mean(y);
  double xy = 0;
  for (size_t i = 0; i < x.size(); ++i) xy += (x[i] - mx) * (y[i] - my);
  return xy / static_cast<double>(x.size()) / std::sqrt(Variance(x) * Variance(y));
}

TEST_CASE("Action noise has mean 0 and the given standard deviation in every component") {
  const PerturbationSet set = Make("action-noise=0.5");
  for (size_t i = 0; i < kActions; ++i) {
    const std::vector<double> column = Column(set, {kEpisode, 1, 0, 0}, i);
    // Five standard errors: std / sqrt(n) of the mean, sqrt(2 / n) of the relative variance.
    CHECK(std::abs(Mean(column)) < 5 * 0.5 / std::sqrt(double{kRows}));
    CHECK(Variance(column) == Approx(0.25).epsilon(5 * std::sqrt(2.0 / kRows)));
  }
}

TEST_CASE("Action noise is independent over components, steps, episodes, lanes and uses") {
  const PerturbationSet set = Make("action-noise=1");
  const std::vector<double> column = Column(set, {kEpisode, 1, 0, 0}, 2);
  const auto check = [&](const std::vector<double>& other) {
    // Five standard errors of a correlation of kRows pairs.
    CHECK(std::abs(Correlation(column, other)) < 5 / std::sqrt(double{kRows}));
  };
  check(Column(set, {kEpisode, 1, 0, 0}, 3));
  check(Column(set, {kEpisode, 1, 0, 0}, 2, 1));  // the next step
  check(Column(set, {kEpisode, 1, 1, 0}, 2));     // the next episode
  check(Column(set, {kEpisode, 2, 0, 0}, 2));     // the next lane
  check(Column(set, {kQuery, 1, 0, 0}, 2));
  // A second noise of the same name, and noise of another name.
  std::vector<double> second =
      Column(Make("action-noise=1,action-noise=1"), {kEpisode, 1, 0, 0}, 2);
  for (size_t i = 0; i < second.size(); ++i) second[i] -= column[i];
  check(second);
  std::vector<double> seen(kRows);
  const PerturbationSet observing = Make("obs-noise=1");
  for (uint64_t i = 0; i < kRows; ++i) {
    std::vector<double> observation(17, 0.0);
    observing.OnObservation({kEpisode, 1, 0, i}, {}, observation);
    seen[i] = observation[2];
  }
  check(seen);
}

TEST_CASE("Action noise of a seed is what it was when the committed results were trained with it") {
  const auto noise = ActionOf(Make("action-noise=1"), {kEpisode, 1, 2, 3});
  CHECK(noise[0] == Approx(0.8688380897).epsilon(1e-9));
  CHECK(noise[5] == Approx(-0.6978768567).epsilon(1e-9));
}

TEST_CASE("Two levels of action noise scale the same normals") {
  const DrawContext context = {kEpisode, 3, 1, 12};
  const auto low = ActionOf(Make("action-noise=0.2"), context);
  const auto high = ActionOf(Make("action-noise=0.5"), context);
  for (size_t i = 0; i < kActions; ++i) {
    CHECK(high[i] == Approx(2.5 * low[i]).epsilon(1e-12));  // 0.5 / 0.2; rounding
  }
}

TEST_CASE("The executed action is clipped to the bounds of every environment") {
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    INFO(entry.name);
    const EnvironmentSpec spec = Take(DescribeEnvironment(entry.name));
    const PerturbationSet set = Make("action-noise=3", spec);
    uint32_t at_low = 0, at_high = 0;
    for (uint64_t step = 0; step < 200; ++step) {
      const std::vector<double> beyond(spec.action.size(), step % 2 == 0 ? 7.0 : -7.0);
      const auto executed = ActionOf(set, {kEpisode, 1, 0, step}, beyond);
      for (size_t i = 0; i < executed.size(); ++i) {
        const DimensionSpec& bounds = spec.action.dimensions[i];
        REQUIRE((executed[i] >= bounds.low && executed[i] <= bounds.high));
        at_low += executed[i] == bounds.low;
        at_high += executed[i] == bounds.high;
      }
    }
    CHECK(at_low > 0);
    CHECK(at_high > 0);
  }
}

TEST_CASE("A lane executes the noisy action; its digest is of the agent's") {
  const PerturbationSet set = Make("action-noise=0.2", Take(DescribeEnvironment("HalfCheetah")));
  TestLane noisy(OpenHalfCheetah("action-noise=0.2"));
  TestLane plain(OpenHalfCheetah());
  noisy.Reset(5);
  plain.Reset(5);
  for (uint64_t k = 0; k < 20; ++k) {
    const std::vector<double> action = RandomAction(kActions, 1, k);
    noisy.Step(action);
    plain.Step(ActionOf(set, {kEpisode, 5, 0, k}, action));
    REQUIRE(noisy.state() == plain.state());
    REQUIRE(noisy.header().reward == plain.header().reward);
    REQUIRE(noisy.header().digest != plain.header().digest);  // it covers what the agent did
  }
}

TEST_CASE("A delay executes zeros, then each action some steps late, in every environment") {
  constexpr uint64_t kDelay = 3;
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    INFO(entry.name);
    const std::string name(entry.name);
    TestLane delayed(Take(TryOpen(name, "action-delay=3")), AutoresetMode::kDisabled);
    TestLane plain(Take(TryOpen(name)), AutoresetMode::kDisabled);
    const size_t actions = plain.stepper().spec().action.size();
    REQUIRE(delayed.record().perturbation_state().size() == kDelay * actions);
    delayed.Reset(5);
    plain.Reset(5);
    for (uint64_t k = 0; k < 12; ++k) {
      plain.Step(k < kDelay ? std::vector<double>(actions, 0.0)
                            : RandomAction(actions, 1, k - kDelay));
      delayed.StepRandomly(k);
      REQUIRE(delayed.state() == plain.state());
    }
    delayed.Reset();
    REQUIRE(ToVector(delayed.record().perturbation_state()) ==
            std::vector<double>(kDelay * actions, 0.0));
  }
}

TEST_CASE(
    "A state that is set into an ended episode starts with an empty queue; in a running one not") {
  TestLane lane(OpenHalfCheetah("action-delay=1", R"({"max_episode_steps": 2})"),
                AutoresetMode::kDisabled);
  lane.Reset(5);
  const NamedState state = lane.GetState();
  lane.StepRandomly(0);
  const std::vector<double> waiting = ToVector(lane.record().perturbation_state());
  REQUIRE(waiting == RandomAction(kActions, 1, 0));
  RequireOk(lane.TrySetState(state));
  CHECK(ToVector(lane.record().perturbation_state()) == waiting);
  lane.StepRandomly(1);
  REQUIRE(lane.header().truncated == 1);
  RequireOk(lane.TrySetState(state));
  CHECK(ToVector(lane.record().perturbation_state()) == std::vector<double>(kActions, 0.0));
}

TEST_CASE("A delayed action that fails has left the queue, and those behind it are executed") {
  TestLane lane(OpenHalfCheetah("action-delay=1"), AutoresetMode::kDisabled);
  TestLane plain(OpenHalfCheetah(), AutoresetMode::kDisabled);
  lane.Reset(5);
  plain.Reset(5);
  lane.Step(std::vector<double>(kActions, 1e300));
  plain.Step(std::vector<double>(kActions, 0.0));
  lane.StepRandomly(0);
  REQUIRE(lane.header().cause == Cause::kNumericalError);
  REQUIRE(lane.state() == plain.state());
  for (uint64_t k = 0; k < 3; ++k) {
    lane.StepRandomly(k + 1);
    plain.StepRandomly(k);
    REQUIRE(lane.header().cause == Cause::kNone);
    REQUIRE(lane.state() == plain.state());
  }
}

TEST_CASE("Noise before a delay and noise behind it are what they are written to be") {
  const EnvironmentSpec spec = Unbounded();
  std::vector<double> queue(kActions, 0.0);
  const PerturbationSet noise_first = Make("action-noise=1,action-delay=1", spec);
  std::vector<double> first(kActions, 0.0), second(kActions, 0.0);
  noise_first.OnAction({kEpisode, 1, 0, 0}, queue, first);
  REQUIRE(first == std::vector<double>(kActions, 0.0));  // the noisy action waits
  noise_first.OnAction({kEpisode, 1, 0, 1}, queue, second);
  REQUIRE(second == ActionOf(Make("action-noise=1", spec), {kEpisode, 1, 0, 0}));

  std::ranges::fill(queue, 0.0);
  std::ranges::fill(first, 0.0);
  Make("action-delay=1,action-noise=1", spec).OnAction({kEpisode, 1, 0, 0}, queue, first);
  REQUIRE(first == ActionOf(Make("action-noise=1", spec), {kEpisode, 1, 0, 0}));
}

TEST_CASE("What remembers steps cannot be queried; noise can") {
  REQUIRE(OpenHalfCheetah("action-delay")->CheckQueryable().code() == StatusCode::kUnsupported);
  REQUIRE(OpenHalfCheetah("action-delay=0")->CheckQueryable().ok());
  const auto noisy = OpenHalfCheetah("action-noise=0.5");
  REQUIRE(noisy->CheckQueryable().ok());
  const auto plain = OpenHalfCheetah();
  const Simulator::Lease a = Take(noisy->Borrow());
  const Simulator::Lease b = Take(plain->Borrow());
  const std::vector<double> observation = RandomAction(17, 2, 0);
  std::vector<double> action = RandomAction(kActions, 2, 1), next(17), expected(17);
  REQUIRE(noisy->Query(*a, {7, 1, 9}, observation, action, next).valid);
  noisy->perturbations().OnAction({kQuery, 7, 1, 9}, {}, action);
  REQUIRE(plain->Query(*b, {7, 1, 9}, observation, action, expected).valid);
  REQUIRE(next == expected);
}

TEST_CASE("A delay that does not fit into a lane's memory is refused with the limit") {
  const auto simulator = Take(TryOpen("Humanoid", "action-delay=100"));
  const auto stepper = LaneStepper::Create(simulator, AutoresetMode::kNextStep);
  REQUIRE(stepper.status().code() == StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace b4mrl
