// Actions at the bounds and far beyond them, on every environment under every preset: no number
// that a client gets is ever NaN or infinite, and what the engine cannot compute ends its episode,
// once.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "proto/base/rng.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

constexpr uint32_t kLanes = 32;
// The motors clip what they execute, but the cost counts the action as it came: beyond this its
// square, and so the reward, is infinite.
constexpr double kOverflowingAction = 1e155;

bool AllFinite(std::span<const double> values) {
  return std::ranges::all_of(values, [](double x) { return std::isfinite(x); });
}

struct Combination {
  std::string environment;
  NamedArgument perturbation;  // without a name: none
  uint64_t share;              // of all steps; the Humanoid's cost ten times as much
};

std::vector<Combination> AllCombinations(Client& client) {
  const pb::CatalogueReply catalogue = Take(client.Catalogue());
  std::vector<Combination> combinations;
  for (const pb::EnvironmentInfo& environment : catalogue.environments()) {
    const uint64_t share = environment.name() == "Humanoid" ? 1 : 4;
    const size_t before = combinations.size();
    combinations.push_back({environment.name(), {}, share});
    for (const pb::PerturbationInfo& perturbation : catalogue.perturbations()) {
      for (const pb::PresetInfo& preset : perturbation.presets()) {
        if (preset.environment() != environment.name()) continue;
        combinations.push_back({environment.name(), {preset.name(), ""}, share});
      }
    }
    // The paper leaves the Humanoid nearly alone; these change its physics and its actions.
    if (combinations.size() - before > 3) continue;
    for (const NamedArgument& item : {NamedArgument{"gravity", "2"}, {"action-noise", "0.2"}}) {
      combinations.push_back({environment.name(), item, share});
    }
  }
  return combinations;
}

// What each lane did last, for the rules that one step's reply alone does not show.
class Watch {
 public:
  // `counts_actions`: whether the reward counts actions as they came.
  Watch(size_t observation_size, bool counts_actions)
      : counts_actions_(counts_actions),
        observation_size_(observation_size),
        last_(kLanes * observation_size) {}

  void Reset(const StepOutcome& outcome) { Remember(outcome); }

  // In mode next_step.
  void Step(const StepOutcome& outcome, std::span<const double> actions) {
    REQUIRE(AllFinite(outcome.observations.As<double>()));
    REQUIRE(AllFinite(outcome.rewards));
    REQUIRE(AllFinite(outcome.infos));
    REQUIRE(AllFinite(outcome.final_returns));
    REQUIRE(AllFinite(outcome.final_infos));
    if (!outcome.final_lanes.empty()) {
      REQUIRE(AllFinite(outcome.final_observations.As<double>()));
    }
    const size_t width = actions.size() / kLanes;
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
      const bool broke = outcome.causes[lane] == static_cast<uint8_t>(Cause::kNumericalError);
      const bool ends = outcome.terminated[lane] || outcome.truncated[lane];
      REQUIRE(std::ranges::count(outcome.final_lanes, lane) == (ends ? 1 : 0));
      if (ended_[lane]) REQUIRE_FALSE(ends);  // this was the reset: no end is reported twice
      if (counts_actions_ && !ended_[lane]) {
        const bool overflows =
            std::ranges::any_of(actions.subspan(lane * width, width),
                                [](double a) { return std::abs(a) > kOverflowingAction; });
        REQUIRE(broke == overflows);
      }
      if (broke) RequireRepeated(outcome, lane);
      broken_ += broke;
      ended_[lane] = ends;
    }
    Remember(outcome);
  }

  uint64_t broken() const { return broken_; }

 private:
  void Remember(const StepOutcome& outcome) {
    std::ranges::copy(outcome.observations.As<double>(), last_.begin());
  }
  // The step left nothing behind: the observation before it, no reward.
  void RequireRepeated(const StepOutcome& outcome, uint32_t lane) {
    REQUIRE(outcome.truncated[lane] == 1);
    REQUIRE(outcome.terminated[lane] == 0);
    REQUIRE(outcome.rewards[lane] == 0);
    const size_t first = lane * observation_size_;
    REQUIRE(std::equal(last_.begin() + first, last_.begin() + first + observation_size_,
                       outcome.observations.As<double>().begin() + first));
  }

  bool counts_actions_;
  size_t observation_size_;
  std::array<bool, kLanes> ended_{};
  std::vector<double> last_;
  uint64_t broken_ = 0;
};

double ExtremeAction(Rng& rng, double bound) {
  static constexpr double kLarge[] = {1.5, 1e3, 1e9, 1e11, 1e200, 1.7e308};
  const double kind = rng.Uniform(0, 1);
  const double sign = rng.Uniform(-1, 1) < 0 ? -1 : 1;
  if (kind < 0.6) return sign * bound;
  if (kind < 0.9) return rng.Uniform(-bound, bound);
  // One number in 100 may overflow, so that most episodes go on for a while.
  const auto choice = static_cast<size_t>(rng.Uniform(0, kind < 0.99 ? 3 : 6));
  return sign * bound * kLarge[choice];
}

// Returns how many episodes the engine gave up.
uint64_t Walk(Client& client, const Combination& combination, uint64_t steps) {
  EnvironmentOptions options;
  if (!combination.perturbation.name.empty()) options.simulator = {combination.perturbation};
  options.num_envs = kLanes;
  options.seed = 3;
  options.observation_dtype = DType::kFloat64;
  options.with_infos = true;
  options.deadline_ms = 60'000;
  RemoteEnvironment environment = Take(client.Make(combination.environment, options));
  const SpaceSpec& space = environment.spec().action;
  // Both clip what they execute, so nothing beyond the bounds reaches the engine or its reward.
  const std::string& name = combination.perturbation.name;
  const bool changes_actions = name.starts_with("action-");
  // Highway clips by its own rule, and its reward does not count the action as it came.
  const bool counts_actions = !changes_actions && combination.environment != "Highway";
  Watch watch(environment.spec().observation.size(), counts_actions);
  watch.Reset(Take(environment.Reset()));
  std::vector<double> actions(kLanes * space.size());
  for (uint64_t k = 0; k < steps; k += kLanes) {
    Rng rng(5, "extreme-actions", k);
    for (size_t i = 0; i < actions.size(); ++i) {
      actions[i] = ExtremeAction(rng, space.dimensions[i % space.size()].high);
    }
    watch.Step(Take(environment.Step(std::span<const double>(actions))), actions);
  }
  return watch.broken();
}

void WalkAll(uint64_t total_steps) {
  const PrivateDaemon daemon = StartDaemon();
  Client client = Connect(daemon.endpoint());
  const std::vector<Combination> combinations = AllCombinations(client);
  uint64_t shares = 0;
  for (const Combination& combination : combinations) shares += combination.share;
  for (const Combination& combination : combinations) {
    INFO(combination.environment << " " << combination.perturbation.ToString());
    const uint64_t broken =
        Walk(client, combination, total_steps * combination.share / shares + kLanes);
    if (combination.environment != "Highway" && combination.perturbation.name.empty()) {
      REQUIRE(broken > 0);
    }
  }
  // Nothing of this ended a process.
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& worker : status.workers()) REQUIRE(worker.restarts() == 0);
}

TEST_CASE(
    "Each warning of the engine ends exactly one episode, with its cause, and no other lane") {
  const PrivateDaemon daemon = StartDaemon();
  Client client = Connect(daemon.endpoint());
  for (const char* name : {"HalfCheetah", "Hopper", "Walker2d", "Humanoid"}) {
    INFO(name);
    EnvironmentOptions two_lanes;
    two_lanes.num_envs = 2;
    two_lanes.seed = 8;
    RemoteEnvironment environment = Take(client.Make(name, two_lanes));
    RemoteEnvironment undisturbed = Take(client.Make(name, two_lanes));
    RequireOk(environment.Reset().status());
    RequireOk(undisturbed.Reset().status());
    // Lane 0 gets velocities that MuJoCo may hold, but whose squares it may not.
    const uint32_t lane_0 = 0;
    LaneStates states = Take(environment.Snapshot({&lane_0, 1}));
    states.snapshot.clear();
    std::ranges::fill(states.parts["qvel"], 5e9);
    const StepOutcome restored = Take(environment.Restore(states, {&lane_0, 1}));
    const size_t size = environment.spec().observation.size();
    const std::span<const float> before = restored.observations.As<float>();
    const std::vector<float> actions(2 * environment.spec().action.size());
    for (int step = 0; step < 3; ++step) {
      const StepOutcome outcome = Take(environment.Step(std::span<const float>(actions)));
      const StepOutcome expected = Take(undisturbed.Step(std::span<const float>(actions)));
      const std::span<const float> got = outcome.observations.As<float>();
      REQUIRE(outcome.digests[1] == expected.digests[1]);
      REQUIRE((outcome.truncated[0] == 1) == (step == 0));
      REQUIRE(outcome.causes[0] ==
              static_cast<uint8_t>(step == 0 ? Cause::kNumericalError : Cause::kNone));
      REQUIRE(outcome.final_lanes.size() == (step == 0 ? 1 : 0));
      if (step > 0) continue;
      REQUIRE(outcome.rewards[0] == 0);
      REQUIRE(std::equal(before.begin(), before.end(), got.begin(), got.begin() + size));
    }
  }
}

TEST_CASE("Extreme actions break episodes, never numbers") { WalkAll(20'000); }

TEST_CASE("A million extreme actions break episodes, never numbers", "[.][long]") {
  WalkAll(1'000'000);
}

}  // namespace
}  // namespace b4mrl
