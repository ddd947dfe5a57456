// Highway as an environment: settings, lanes, states, queries. The simulator itself is tested in
// tests/server/highway.
#include <cmath>
#include <map>

#include "server/perturbations/list.h"
#include "tests/server/environments/simulation.h"
#include "tests/server/highway/highway_reference.h"

namespace b4mrl {
namespace {

std::shared_ptr<const Simulator> OpenHighway(const std::string& perturbations = "",
                                             const std::string& config = "") {
  return Take(TryOpen("Highway", perturbations, config));
}

using Catch::Contains;

// Why a configuration is refused.
std::string Why(const std::string& config) {
  const auto result = TryOpen("Highway", "", config);
  REQUIRE_FALSE(result.ok());
  return result.status().message();
}

size_t CarsOf(const std::shared_ptr<const Simulator>& simulator) {
  TestLane lane(simulator);
  lane.Reset(1);
  return lane.GetState().at("vehicles").size() / kVehicleColumns;
}

TEST_CASE("Lanes follow the recordings of highway-env from seed to end") {
  size_t compared = 0;
  for (const HighwayTrajectory& t : ReadHighwayTrajectories()) {
    if (t.scrambled) continue;
    INFO(t.name);
    TestLane lane(OpenHighway("", t.config), AutoresetMode::kDisabled);
    lane.Reset(t.seed);
    for (uint64_t i = 0; i < t.episode; ++i) lane.Reset();
    const ActionPrecision precision =
        t.float32 ? ActionPrecision::kFloat32 : ActionPrecision::kFloat64;
    for (size_t i = 0; i < t.steps.size(); ++i) {
      INFO("step " << i);
      const HighwayStep& step = t.steps[i];
      lane.Step(step.action, precision);
      CHECK(lane.header().terminated == step.terminated);
      CHECK(lane.header().truncated == step.truncated);
      if (i >= t.strict_steps) continue;
      CHECK(std::abs(lane.header().reward - step.reward) <= 1e-9);  // as simulation_test.cc says
      const std::vector<double> vehicles = lane.GetState().at("vehicles");
      for (size_t k = 0; k < t.vehicles * kRecordedColumns; ++k) {
        const size_t row = k / kRecordedColumns, column = k % kRecordedColumns;
        REQUIRE(std::abs(vehicles[row * kVehicleColumns + column] - step.states[k]) <= 1e-9);
      }
      ++compared;
    }
  }
  CHECK(compared > 200);
}

TEST_CASE("Saved and loaded at every step, lanes continue with equal bits on other objects") {
  const auto simulator = OpenHighway("cars=15");
  TestLane straight(simulator);
  straight.Reset(11);
  const Simulator::Lease scratch[] = {Take(simulator->Borrow()), Take(simulator->Borrow())};
  std::vector<double> state = straight.state();
  for (uint64_t k = 0; k < 20; ++k) {
    const std::vector<double> action = {0.1, k % 2 == 0 ? 0.01 : -0.01};
    straight.Step(action);
    if (straight.header().episode_ended) break;
    scratch[k % 2]->LoadState(state);
    scratch[k % 2]->Step(action);
    scratch[k % 2]->SaveState(state);
    REQUIRE(EqualBytes(state, straight.state()));
  }
}

TEST_CASE("A named state put into another lane continues with equal bits") {
  const auto simulator = OpenHighway("cars=15");
  TestLane original(simulator, AutoresetMode::kDisabled);
  original.Reset(4);
  for (uint64_t k = 0; k < 6; ++k) original.StepRandomly(k);
  TestLane copy(simulator, AutoresetMode::kDisabled);
  RequireOk(copy.TrySetState(original.GetState()));
  REQUIRE(copy.state() == original.state());
  for (uint64_t k = 6; k < 12; ++k) {
    original.StepRandomly(k);
    copy.StepRandomly(k);
    REQUIRE(copy.state() == original.state());
    REQUIRE(copy.header().truncated == original.header().truncated);
  }
}

TEST_CASE("The time is part of the state and decides when an episode is truncated") {
  TestLane lane(OpenHighway(), AutoresetMode::kDisabled);
  lane.Reset(1);
  NamedState state = lane.GetState();
  state["time"] = {29};
  RequireOk(lane.TrySetState(state));
  lane.Step(std::vector<double>{0, 0});
  CHECK(lane.header().truncated);
  CHECK(lane.header().cause == Cause::kLimit);
  state["time"] = {0};
  RequireOk(lane.TrySetState(state));
  lane.Step(std::vector<double>{0, 0});
  CHECK_FALSE(lane.header().truncated);
}

TEST_CASE("Episodes last as many steps as the original's running sum of seconds takes") {
  const auto steps = [](const std::string& config) {
    return OpenHighway("", config)->spec().max_episode_steps;
  };
  CHECK(steps("") == 30);
  CHECK(steps(R"({"env_id": "highway-v0"})") == 40);
  // 1/3, 1/5, 1/12 and 1/15 s add up to a little less than 30 s.
  const std::map<int, uint32_t> expected = {{2, 60},   {3, 91},   {4, 120},  {5, 151},
                                            {10, 300}, {12, 361}, {15, 451}, {30, 900}};
  for (const auto& [frequency, count] : expected) {
    INFO(frequency << " Hz");
    CHECK(steps(R"({"simulation_frequency": 30, "policy_frequency": )" + std::to_string(frequency) +
                "}") == count);
  }
  CHECK(steps(R"({"duration": 40, "simulation_frequency": 20, "policy_frequency": 20})") == 801);
  CHECK(steps(R"({"duration": 0})") == 1);
}

TEST_CASE("The real environment has 3 other cars, the simulator 15, a chosen task its own number") {
  CHECK(CarsOf(OpenHighway()) == 4);
  CHECK(CarsOf(OpenHighway("cars")) == 16);
  CHECK(CarsOf(OpenHighway("cars=0")) == 1);
  CHECK(CarsOf(OpenHighway("cars=127")) == 128);
  CHECK(CarsOf(OpenHighway("", R"({"env_id": "highway-fast-v0"})")) == 21);
  CHECK(CarsOf(OpenHighway("", R"({"env_id": "highway-v0"})")) == 51);
  CHECK(CarsOf(OpenHighway("cars=2", R"({"vehicles_count": 9})")) == 3);
  CHECK_FALSE(TryOpen("Highway", "cars=128").ok());
  CHECK_FALSE(TryOpen("Highway", "cars=-1").ok());
  CHECK(TryOpen("HalfCheetah", "cars=3").status().code() == StatusCode::kUnsupported);
  CHECK(TryOpen("HalfCheetah", "cars").status().code() == StatusCode::kUnsupported);
}

TEST_CASE("The default start is the same whatever the number of cars behind the first ones") {
  TestLane few(OpenHighway()), many(OpenHighway("cars"));
  few.Reset(9);
  many.Reset(9);
  const std::vector<double> a = few.GetState().at("vehicles");
  const std::vector<double> b = many.GetState().at("vehicles");
  CHECK(std::equal(a.begin(), a.end(), b.begin()));  // cars are drawn one after another
}

TEST_CASE("The space has a row a car and a name for each number") {
  const auto simulator = OpenHighway();
  const SpaceSpec& space = simulator->spec().observation;
  CHECK(space.shape == std::vector<uint64_t>{5, 5});
  CHECK(space.dimensions[3].name == "ego-vx");
  CHECK(space.dimensions[24].name == "vehicle4-vy");
  CHECK(space.dimensions[24].feature == "vy");
  CHECK(space.dimensions[20].flag);
  CHECK(simulator->spec().action.dimensions[0].name == "throttle");
  const auto steering =
      OpenHighway("", R"({"action": {"type": "ContinuousAction", "longitudinal": false}})");
  CHECK(steering->spec().action.size() == 1);
  CHECK(steering->spec().action.dimensions[0].name == "steering");
}

TEST_CASE("Infos are those of highway-env's dictionary") {
  TestLane lane(OpenHighway());
  lane.Reset(2);
  const std::vector<std::string>& names = lane.stepper().spec().info_names;
  const auto info = [&](const std::string& name) {
    const auto at = std::ranges::find(names, name);
    REQUIRE(at != names.end());
    return lane.record().infos()[at - names.begin()];
  };
  CHECK(info("speed") == 25);
  lane.Step(std::vector<double>{0.25, -2});
  CHECK(info("action[0]") == 0.25);
  CHECK(info("action[1]") == -2);  // as given
  CHECK(info("crashed") == 0);
  CHECK(info("rewards.collision_reward") == 0);
  const double expected =
      (0.1 * info("rewards.right_lane_reward") + 0.4 * info("rewards.high_speed_reward") + 1) /
      1.5 * info("rewards.on_road_reward");
  CHECK(lane.header().reward == Approx(expected).epsilon(1e-12));  // rounding
}

TEST_CASE("A query is a step from the cars that the observation shows") {
  const auto simulator = OpenHighway("cars");
  REQUIRE(simulator->CheckQueryable().ok());
  TestLane lane(simulator);
  lane.Reset(3);
  lane.Step(std::vector<double>{0, 0});
  const std::vector<double> observation = lane.observation();
  const std::vector<double> action = {0.3, 0.02};
  std::vector<double> next(observation.size()), again(observation.size());
  const auto environment = Take(simulator->Borrow());
  const QueryResult result = environment->Query(observation, action, next);
  REQUIRE(result.valid);
  CHECK(environment->Query(observation, action, again).reward == result.reward);
  CHECK(next == again);
  // The ego's next speed depends on nothing that the observation hides.
  lane.Step(action);
  CHECK(next[3] == Approx(lane.observation()[3]).margin(1e-6));  // float32
  CHECK(result.reward == Approx(lane.header().reward).margin(1e-5));
}

TEST_CASE("A query from numbers that describe no state is marked as invalid") {
  const auto simulator = OpenHighway();
  const auto environment = Take(simulator->Borrow());
  std::vector<double> observation(25, 0.2), next(25, 7);
  const std::vector<double> action = {0, 0};
  observation[3] = std::nan("");
  CHECK_FALSE(environment->Query(observation, action, next).valid);
  CHECK(next == std::vector<double>(25, 0));
  observation[3] = 1e300;
  CHECK_FALSE(environment->Query(observation, action, next).valid);
  const auto blind = OpenHighway("", R"({"observation": {"features": ["presence", "x", "y"]}})");
  CHECK(blind->CheckQueryable().code() == StatusCode::kUnsupported);
}

TEST_CASE("A query's action is clipped as a step's is, however large") {
  const auto simulator = OpenHighway();
  TestLane lane(simulator);
  lane.Reset(3);
  const auto environment = Take(simulator->Borrow());
  std::vector<double> next(25), expected(25);
  CHECK(environment->Query(lane.observation(), std::vector<double>{1e300, -1e11}, next).valid);
  CHECK(environment->Query(lane.observation(), std::vector<double>{1, -1}, expected).valid);
  CHECK(next == expected);
}

TEST_CASE("An observation may show more cars than the real environment has") {
  const auto many = OpenHighway("cars"), few = OpenHighway("", R"({"vehicles_count": 1})");
  TestLane lane(many);
  lane.Reset(3);
  std::vector<double> next(25);
  CHECK(Take(few->Borrow())->Query(lane.observation(), std::vector<double>{0, 0}, next).valid);
  CHECK(next[20] == 1);  // the last of four cars
}

TEST_CASE("States that are no states of a highway are refused by name") {
  TestLane lane(OpenHighway());
  lane.Reset(1);
  const NamedState good = lane.GetState();
  const auto refusal = [&](const std::string& part, const std::vector<double>& values) {
    NamedState state = good;
    state[part] = values;
    const Status status = lane.TrySetState(state);
    REQUIRE_FALSE(status.ok());
    return status;
  };
  std::vector<double> vehicles = good.at("vehicles");
  CHECK_THAT(refusal("vehicles", {}).message(), Contains("15 numbers for each of 1 to 5 cars"));
  CHECK_THAT(refusal("vehicles", std::vector<double>(16)).message(), Contains("vehicles"));
  CHECK_THAT(refusal("vehicles", std::vector<double>(6 * 15)).message(), Contains("vehicles"));
  CHECK_THAT(refusal("speed", {1}).message(), Contains("'speed'"));
  CHECK_THAT(refusal("time", {1, 2}).message(), Contains("length of state part 'time' is 2"));
  CHECK_THAT(refusal("time", {-1e11}).message(),
             Contains("'time' is -100000000000, allowed: -1e10..1e10 seconds"));
  vehicles[15 + 4] = 3;  // of lanes 0 to 2
  CHECK_THAT(refusal("vehicles", vehicles).message(), Contains("vehicles[1][4]"));
  vehicles[15 + 4] = 1.5;
  CHECK_THAT(refusal("vehicles", vehicles).message(), Contains("whole numbers"));
  vehicles[15 + 4] = 0;
  vehicles[15 + 7] = 0.5;
  CHECK_THAT(refusal("vehicles", vehicles).message(), Contains("vehicles[1][7]"));
  vehicles[15 + 7] = 0;
  vehicles[2] = std::nan("");
  CHECK_THAT(refusal("vehicles", vehicles).message(), Contains("vehicles[0][2]"));
  RequireOk(lane.TrySetState({{"vehicles", std::vector<double>(15, 0.0)}}));  // the ego alone
  CHECK(lane.GetState().at("vehicles").size() == 15);
}

TEST_CASE("An empty table of ranges stands for the default ones, as in highway-env") {
  TestLane given(Take(TryOpen("Highway", "", R"({"observation": {"features_range": {}}})")));
  TestLane plain(OpenHighway());
  given.Reset(3);
  plain.Reset(3);
  CHECK(given.observation() == plain.observation());
}

TEST_CASE("Settings that mean something else here are refused with their name") {
  CHECK_THAT(Why(R"({"vehicle_count": 3})"), Contains("'vehicles_count'"));
  CHECK_THAT(Why(R"({"env_id": "roundabout-v0"})"), Contains("highway-fast-v0, highway-v0"));
  CHECK_THAT(Why(R"({"action": {"type": "DiscreteMetaAction"}})"), Contains("action: type"));
  CHECK_THAT(Why(R"({"action": {"lateral": false, "longitudinal": false}})"), Contains("both"));
  CHECK_THAT(Why(R"({"action": {"steering_range": [1, 0]}})"), Contains("steering_range"));
  CHECK_THAT(Why(R"({"action": {"speed_range": [null, 3]}})"),
             Contains("speed_range") && Contains("two numbers with low < high"));
  CHECK_THAT(Why(R"({"action": {"dynamical": true}})"), Contains("tyre"));
  CHECK_THAT(Why(R"({"action": 3})"), Contains("a dictionary"));
  CHECK_THAT(Why(R"({"observation": {"type": "OccupancyGrid"}})"), Contains("Kinematics"));
  CHECK_THAT(Why(R"({"observation": {"features": ["presnce"]}})"), Contains("'presence'"));
  CHECK_THAT(Why(R"({"observation": {"features": ["x", "x"]}})"), Contains("once"));
  CHECK_THAT(Why(R"({"observation": {"features": []}})"), Contains("features"));
  CHECK_THAT(Why(R"({"observation": {"order": "shuffled"}})"), Contains("sorted"));
  CHECK_THAT(Why(R"({"observation": {"features_range": {"z": [0, 1]}}})"), Contains("'z'"));
  CHECK_THAT(Why(R"({"observation": {"clip": false, "features_range": {"x": [0, 1e-45]}}})"),
             Contains("features_range: x") && Contains("1e-9 apart"));
  CHECK_THAT(Why(R"({"controlled_vehicles": 2})"), Contains("one car"));
  CHECK_THAT(Why(R"({"lanes_count": 0})"), Contains("lanes_count"));
  CHECK_THAT(Why(R"({"initial_lane_id": 3})"), Contains("initial_lane_id"));
  CHECK_THAT(Why(R"({"vehicles_density": 0})"), Contains("vehicles_density"));
  CHECK_THAT(Why(R"({"policy_frequency": 0})"), Contains("policy_frequency"));
  CHECK_THAT(Why(R"({"simulation_frequency": 1000, "policy_frequency": 0.5})"),
             Contains("simulation_frequency"));
  CHECK_THAT(Why(R"({"reward_speed_range": [20, 20]})"), Contains("reward_speed_range"));
  CHECK_THAT(Why(R"({"collision_reward": 0.5})"), Contains("normalize_reward"));
  CHECK(
      TryOpen("Highway", "", R"({"initial_lane_id": null, "action": {"speed_range": null}})").ok());
}

TEST_CASE("Settings of highway-env's window are taken and change no picture and no experiment") {
  const std::string window = R"({"centering_position": [0.5, 0.3], "scaling": 8,
                                 "render_agent": false, "lock_window": true})";
  const auto given = OpenHighway("", window);
  CHECK(OpenHighway("", given->config_json())->config_json() == given->config_json());
  const std::string plain = OpenHighway()->config_json();
  for (const char* key : {"centering_position", "scaling", "render_agent", "lock_window"}) {
    CHECK(plain.find(key) == std::string::npos);
  }
  TestLane lane(given), other(OpenHighway());
  lane.Reset(1);
  other.Reset(1);
  lane.StepRandomly(0);
  other.StepRandomly(0);
  CHECK(lane.state() == other.state());
  for (const char* place : {"3", "[1]", R"(["left", 0])", "[1, 2, 3]"}) {
    CHECK_THAT(Why(R"({"centering_position": )" + std::string(place) + "}"),
               Contains("centering_position") && Contains("two numbers"));
  }
  CHECK_THAT(Why(R"({"scaling": -1})"), Contains("scaling"));
}

TEST_CASE("Rows and cars beyond a lane's memory are refused with their numbers") {
  const auto simulator = OpenHighway("", R"({"vehicles_count": 3, "observation": {
      "vehicles_count": 128, "features": ["presence", "x", "y", "vx", "vy", "heading", "cos_h",
                                          "sin_h"]}})");
  const Status status = LaneStepper::Create(simulator, AutoresetMode::kNextStep).status();
  INFO(status.ToString());
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(status.message(), Contains("1024 numbers (128 x 8)") && Contains("at most 16384"));
}

TEST_CASE("A completed configuration completes to itself") {
  for (const char* config : {"", R"({"env_id": "highway-v0", "action": {"clip": false}})"}) {
    const std::string once = OpenHighway("", config)->config_json();
    CHECK(OpenHighway("", once)->config_json() == once);
  }
}

TEST_CASE("Float32 actions keep their precision unless a perturbation changes them") {
  const auto step = [](const std::string& perturbations, ActionPrecision precision) {
    TestLane lane(OpenHighway(perturbations));
    lane.Reset(1);
    lane.Step(std::vector<double>{0.5, 0.125}, precision);
    return lane.state();
  };
  CHECK(step("", ActionPrecision::kFloat32) != step("", ActionPrecision::kFloat64));
  for (const char* noise : {"action-noise=0.1", "action-noise=1000000", "action-noise=0"}) {
    INFO(noise);  // of 1e6: clipped to the bounds, -1 or 1, which are float32 numbers
    CHECK(step(noise, ActionPrecision::kFloat32) == step(noise, ActionPrecision::kFloat64));
    CHECK_THAT(OpenHighway(noise)->identity(), Contains("actions in float64"));
  }
  CHECK(step("action-delay=0", ActionPrecision::kFloat32) == step("", ActionPrecision::kFloat32));
  CHECK_THAT(OpenHighway("action-delay=1")->identity(), !Contains("actions in float64"));
}

}  // namespace
}  // namespace b4mrl
