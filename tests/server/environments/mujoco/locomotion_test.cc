// Settings, health, infos and starts of the MuJoCo tasks.
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

constexpr const char* kTasks[] = {"HalfCheetah", "Hopper", "Walker2d", "Humanoid"};

std::shared_ptr<const Simulator> Open(const std::string& environment,
                                      const std::string& config = "") {
  return Take(TryOpen(environment, "", config));
}

std::map<std::string, double> InfosOf(const Simulator& simulator, const Environment& environment) {
  const std::vector<std::string>& names = simulator.spec().info_names;
  std::vector<double> values(names.size());
  environment.Infos(values);
  std::map<std::string, double> infos;
  for (size_t i = 0; i < names.size(); ++i) infos[names[i]] = values[i];
  return infos;
}

void ResetFrom(Environment& environment, uint64_t seed) {
  Rng rng(seed, "reset");
  RequireOk(environment.Reset(rng));
}

TEST_CASE("The spaces are those of the Gymnasium tasks, each dimension with a name of its own") {
  struct Expected {
    const char* environment;
    const char* config;
    size_t observation, action;
    double action_bound, step_seconds;
  };
  const Expected kExpected[] = {
      {"HalfCheetah", "", 17, 6, 1, 0.05},
      {"HalfCheetah", R"({"exclude_current_positions_from_observation": false})", 18, 6, 1, 0.05},
      {"Hopper", "", 11, 3, 1, 0.008},
      {"Hopper", R"({"exclude_current_positions_from_observation": false})", 12, 3, 1, 0.008},
      {"Walker2d", R"({"frame_skip": 2})", 17, 6, 1, 0.004},
      {"Humanoid", "", 376, 17, 0.4, 0.015},
      {"Humanoid", R"({"exclude_current_positions_from_observation": false})", 378, 17, 0.4, 0.015},
      {"Humanoid", R"({"version": "v5"})", 348, 17, 0.4, 0.015},
      {"Humanoid", R"({"version": "v5", "include_cinert_in_observation": false,
                       "include_cfrc_ext_in_observation": false})",
       140, 17, 0.4, 0.015},
      {"Humanoid", R"({"version": "v5", "include_cvel_in_observation": false,
                       "include_qfrc_actuator_in_observation": false})",
       253, 17, 0.4, 0.015}};
  for (const Expected& expected : kExpected) {
    INFO(expected.environment << " " << expected.config);
    const auto simulator = Open(expected.environment, expected.config);
    const EnvironmentSpec& spec = simulator->spec();
    REQUIRE(spec.observation.size() == expected.observation);
    REQUIRE(spec.action.size() == expected.action);
    REQUIRE(spec.step_seconds == expected.step_seconds);
    std::set<std::string> names;
    for (const DimensionSpec& dimension : spec.observation.dimensions) {
      names.insert(dimension.name);
      REQUIRE(std::isinf(dimension.low));
    }
    REQUIRE(names.size() == expected.observation);
    for (const DimensionSpec& dimension : spec.action.dimensions) {
      REQUIRE(dimension.high == expected.action_bound);
      REQUIRE(dimension.low == -expected.action_bound);
    }
  }
}

TEST_CASE("Resets draw positions and velocities uniformly around the model's start") {
  for (const char* name : {"Hopper", "Walker2d", "Humanoid"}) {
    INFO(name);
    const double scale = std::string(name) == "Humanoid" ? 0.01 : 0.005;
    const auto simulator = Open(name);
    const auto still = Open(name, R"({"reset_noise_scale": 0})");
    const auto environment = Take(simulator->Borrow());
    const auto fixed = Take(still->Borrow());
    ResetFrom(*fixed, 1);
    const NamedState start = fixed->GetNamedState();
    constexpr int kResets = 2000;
    double squares = 0;
    size_t count = 0;
    for (uint64_t seed = 0; seed < kResets; ++seed) {
      ResetFrom(*environment, seed);
      const NamedState state = environment->GetNamedState();
      for (const char* part : {"qpos", "qvel"}) {
        for (size_t i = 0; i < state.at(part).size(); ++i) {
          // A free body's quaternion is normalised, which bends its noise.
          if (std::string(part) == "qpos" && scale == 0.01 && i >= 3 && i < 7) continue;
          const double noise = state.at(part)[i] - start.at(part)[i];
          REQUIRE(std::abs(noise) <= scale * (1 + 1e-12));  // rounding of the difference
          squares += noise * noise;
          ++count;
        }
      }
    }
    // A uniform square's standard deviation is 0.9 of its mean; 5 standard errors of at least
    // 24,000 draws are 2.9 %.
    CHECK(squares / count == Approx(scale * scale / 3).epsilon(0.029));
  }
}

TEST_CASE("An unhealthy body ends the episode, and what surviving pays depends on the version") {
  // A Hopper that lies on the floor.
  const NamedState fallen = {{"qpos", {0, 0.3, 1.2, 0, 0, 0}}, {"qvel", std::vector<double>(6)}};
  struct Expected {
    const char* config;
    bool terminated;
    double survive;
  };
  const Expected kExpected[] = {
      {R"({"version": "v4", "healthy_reward": 7})", true, 7},
      {R"({"version": "v5", "healthy_reward": 7})", true, 0},
      {R"({"version": "v4", "healthy_reward": 7, "terminate_when_unhealthy": false})", false, 0},
      {R"({"version": "v5", "healthy_reward": 7, "terminate_when_unhealthy": false})", false, 0},
      {R"({"version": "v5", "healthy_reward": 7, "healthy_z_range": [null, null],
           "healthy_angle_range": [-3, 3]})",
       false, 7}};
  for (const Expected& expected : kExpected) {
    INFO(expected.config);
    const auto simulator = Open("Hopper", expected.config);
    const auto environment = Take(simulator->Borrow());
    RequireOk(environment->SetNamedState(fallen));
    const StepResult result = environment->Step(std::vector<double>(3, 0.0));
    CHECK(result.terminated == expected.terminated);
    CHECK((result.cause == Cause::kUnhealthy) == expected.terminated);
    const double x = environment->GetNamedState().at("qpos")[0];
    CHECK(result.reward == x / 0.008 + expected.survive);
  }
}

TEST_CASE("Each bound of health is strict and its own") {
  struct Probe {
    const char* environment;
    size_t coordinate;  // of qpos, then of qvel
    double good, bad;   // after the step, which moves little
  };
  const Probe kProbes[] = {{"Hopper", 1, 0.75, 0.65},   {"Hopper", 2, 0.15, 0.25},
                           {"Hopper", 2, -0.15, -0.25}, {"Hopper", 6 + 3, 80, 150},
                           {"Walker2d", 1, 0.85, 0.75}, {"Walker2d", 1, 1.9, 2.1},
                           {"Walker2d", 2, 0.9, 1.1},   {"Walker2d", 2, -0.9, -1.1},
                           {"Humanoid", 2, 1.1, 0.95},  {"Humanoid", 2, 1.9, 2.05}};
  for (const Probe& probe : kProbes) {
    INFO(probe.environment << " " << probe.coordinate);
    const auto simulator = Open(probe.environment, R"({"reset_noise_scale": 0, "frame_skip": 1})");
    const auto environment = Take(simulator->Borrow());
    ResetFrom(*environment, 0);
    const NamedState start = environment->GetNamedState();
    for (const double value : {probe.good, probe.bad}) {
      NamedState state = {{"qpos", start.at("qpos")}, {"qvel", start.at("qvel")}};
      const size_t positions = state["qpos"].size();
      (probe.coordinate < positions ? state["qpos"][probe.coordinate]
                                    : state["qvel"][probe.coordinate - positions]) = value;
      RequireOk(environment->SetNamedState(state));
      const std::vector<double> action(simulator->spec().action.size());
      CHECK(environment->Step(action).terminated == (value == probe.bad));
    }
  }
}

TEST_CASE("Infos carry the reward's terms, and a reset those that Gymnasium's reset has") {
  for (const char* name : kTasks) {
    for (const bool v5 : {false, true}) {
      INFO(name << (v5 ? " v5" : " v4"));
      const auto simulator = Open(name, v5 ? R"({"version": "v5"})" : "");
      const EnvironmentSpec& spec = simulator->spec();
      const auto environment = Take(simulator->Borrow());
      ResetFrom(*environment, 4);
      REQUIRE(spec.reset_info_names.empty() == !v5);
      for (const auto& [info, value] : InfosOf(*simulator, *environment)) {
        const bool at_reset = std::ranges::count(spec.reset_info_names, info) > 0;
        if (!at_reset) CHECK(value == 0);
        if (info == "x_position" && v5) CHECK(value == environment->GetNamedState().at("qpos")[0]);
      }
      const double x_before = environment->GetNamedState().at("qpos")[0];
      const StepResult result = environment->Step(RandomAction(spec.action.size(), 1, 1));
      const auto infos = InfosOf(*simulator, *environment);
      const bool is_humanoid = std::string(name) == "Humanoid";
      if (!is_humanoid) {
        const double x = environment->GetNamedState().at("qpos")[0];
        CHECK(infos.at("x_position") == x);
        CHECK(infos.at("x_velocity") == (x - x_before) / spec.step_seconds);
      }
      double sum = 0;
      for (const auto& [info, value] : infos) {
        if (info.starts_with("reward_")) sum += value;
      }
      // The planar walkers of version 4 report no terms.
      if (infos.contains("reward_ctrl") || infos.contains("reward_quadctrl")) {
        CHECK(sum == Approx(result.reward).epsilon(1e-12));  // another order of the sum
      }
    }
  }
}

TEST_CASE("Positions in the observation are those of the state, and queries start from them") {
  for (const char* name : {"HalfCheetah", "Hopper", "Humanoid"}) {
    INFO(name);
    const size_t extra = std::string(name) == "Humanoid" ? 2 : 1;
    const auto simulator = Open(name, R"({"exclude_current_positions_from_observation": false})");
    const auto environment = Take(simulator->Borrow());
    ResetFrom(*environment, 2);
    for (uint64_t k = 0; k < 5; ++k) {
      environment->Step(RandomAction(simulator->spec().action.size(), 1, k));
    }
    std::vector<double> observation(simulator->spec().observation.size());
    environment->Observe(observation);
    const NamedState state = environment->GetNamedState();
    REQUIRE(
        EqualBytes(std::span(observation).first(extra), std::span(state.at("qpos")).first(extra)));
    observation[0] = 7;
    std::vector<double> next(observation.size());
    const auto action = RandomAction(simulator->spec().action.size(), 1, 5);
    REQUIRE(environment->Query(observation, action, next).valid);
    REQUIRE(std::abs(next[0] - 7) < 1);  // a control step moves nothing as far as a metre
  }
}

TEST_CASE("A clipped velocity comes back as the limit, everything else as it was") {
  const auto simulator = Open("Walker2d");
  const auto environment = Take(simulator->Borrow());
  ResetFrom(*environment, 2);
  NamedState state = environment->GetNamedState();
  state["qvel"][4] = 25;
  state["qvel"][5] = -25;
  state["qpos"][0] = 3;
  RequireOk(environment->SetNamedState(state));
  std::vector<double> observation(17), queried(17), stepped(17);
  environment->Observe(observation);
  const std::vector<double> action = RandomAction(6, 1, 0);
  REQUIRE(environment->Query(observation, action, queried).valid);
  state["qpos"][0] = 0;
  state["qvel"][4] = 10;
  state["qvel"][5] = -10;
  state["qacc_warmstart"].assign(9, 0.0);
  RequireOk(environment->SetNamedState(state));
  environment->Step(action);
  environment->Observe(stepped);
  REQUIRE(queried == stepped);
}

TEST_CASE("Settings that a task or version lacks are refused by name") {
  const auto refusal = [](const std::string& environment, const std::string& config) {
    const auto result = TryOpen(environment, "", config);
    REQUIRE_FALSE(result.ok());
    return result.status().message();
  };
  using Catch::Contains;
  CHECK_THAT(refusal("HalfCheetah", R"({"healthy_reward": 1})"), Contains("healthy_reward"));
  CHECK_THAT(refusal("Walker2d", R"({"healthy_state_range": [0, 1]})"),
             Contains("healthy_state_range"));
  CHECK_THAT(refusal("Humanoid", R"({"contact_cost_weight": 1})"), Contains("contact_cost_weight"));
  CHECK_THAT(refusal("Hopper", R"({"healthy_z_range": [1, 1]})"), Contains("healthy_z_range"));
  CHECK_THAT(refusal("Hopper", R"({"healthy_z_range": [1]})"), Contains("low < high"));
  CHECK_THAT(refusal("Hopper", R"({"healthy_z_range": 1})"), Contains("low < high"));
  CHECK_THAT(refusal("Hopper", R"({"healthy_z_range": [0, "x"]})"), Contains("low < high"));
  CHECK_THAT(refusal("Hopper", R"({"frame_skip": 0})"), Contains("1..100"));
}

TEST_CASE("A completed configuration completes to itself") {
  for (const char* name : kTasks) {
    for (const char* config : {"", R"({"version": "v5"})"}) {
      const auto once = Open(name, config);
      REQUIRE(Open(name, once->config_json())->config_json() == once->config_json());
    }
  }
}

}  // namespace
}  // namespace b4mrl
