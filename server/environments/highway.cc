// Highway: one controlled car among others on a straight road (server/highway).
//   observation  rows of features, the ego's first; as the configuration's `observation` says
//   action       throttle and steering in [-1, 1], or one of them; clipped beyond
//   reward       for the right lane and speed, against collisions; 0 off the road
//   termination  the ego has crashed, or, with offroad_terminal, has left the road
//   truncation   after `duration` seconds of policy steps; the time is part of the state
//   reset        highway-env's own random numbers: reset(seed=s) and the resets after it
// A query starts from the cars that the observation shows; observation.h says what is lost.
// Settings, formulas and names: highway-env 1.12's highway-v0 and highway-fast-v0 with
// ContinuousAction. Without settings it is highway-fast-v0 with 3 other cars, our reading of the
// paper's real environment; its simulator has 15.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "server/environments/canvas.h"
#include "server/environments/highway_config.h"
#include "server/environments/highway_plan.h"
#include "server/environments/list.h"
#include "server/highway/observation.h"
#include "server/highway/simulation.h"

namespace b4mrl {
namespace {

// Greatest absolute value accepted in a state or in a query's observation.
constexpr double kLargestValue = 1e10;

size_t Capacity(const HighwaySettings& settings) {
  return std::max(settings.vehicles_count + 1, settings.observation.rows);
}

bool AllReasonable(std::span<const double> values) {
  return std::ranges::all_of(values, [](double x) { return std::abs(x) <= kLargestValue; });
}

using ConfigUnder = std::function<Config(std::span<const double> parameters)>;

class Highway final : public Environment {
 public:
  // `spec` and `config_under` (EnvironmentSetup's) outlive the object. It has room for the cars,
  // and the rows of observations, that `settings` asks for.
  Highway(const EnvironmentSpec& spec, const HighwaySettings& settings,
          const ConfigUnder& config_under)
      : spec_(spec),
        config_under_(config_under),
        settings_(settings),
        simulation_(settings_, Capacity(settings)) {}
  Highway(const Highway&) = delete;  // simulation_ refers to settings_

  const EnvironmentSpec& spec() const override { return spec_; }
  // A state is the time, then the cars as Traffic::Save writes them.
  size_t state_size() const override { return 1 + Traffic::StateSize(traffic().capacity()); }

  Status Reset(Rng& rng) override { return StartEpisode(rng.NextUint64(), 0); }
  Status StartEpisode(uint64_t lane_seed, uint64_t episode) override;
  StepResult Step(std::span<const double> action) override { return Step(action, false); }
  StepResult StepFloat32(std::span<const double> action) override { return Step(action, true); }
  bool TimeIsOver(uint64_t /*elapsed_steps*/) const override { return simulation_.TimeIsOver(); }
  void Observe(std::span<double> observation) const override {
    ObserveTraffic(settings_.observation, traffic(), observation);
  }
  void Infos(std::span<double> infos) const override;
  void SaveState(std::span<double> state) const override;
  void LoadState(std::span<const double> state) override;
  NamedState GetNamedState() const override;
  Status SetNamedState(const NamedState& state) override;
  QueryResult Query(std::span<const double> observation, std::span<const double> action,
                    std::span<double> next_observation) override;
  Status Draw(Canvas& canvas) override;

 private:
  const Traffic& traffic() const { return simulation_.traffic; }
  StepResult Step(std::span<const double> action, bool single_precision);
  // Sets outcome_ and action_ after a reset or SetNamedState, which no action led to.
  void Settle();
  std::vector<double> Vehicles() const;
  Status CheckVehicles(std::span<const double> vehicles) const;

  const EnvironmentSpec& spec_;
  const ConfigUnder& config_under_;
  HighwaySettings settings_;
  HighwaySimulation simulation_;
  // The last step's outcome and action, for Infos.
  HighwayOutcome outcome_;
  std::array<double, 2> action_ = {};
};

void Highway::Settle() {
  outcome_ = simulation_.Judge();
  action_ = {};
}

Status Highway::StartEpisode(uint64_t lane_seed, uint64_t episode) {
  // Perturbations vary the number of cars alone, which only a start reads. This takes 10 us.
  if (!parameters().empty()) {
    const std::optional<size_t> most = settings_.most_vehicles;
    settings_ = ReadHighwaySettings(config_under_(parameters()));
    settings_.most_vehicles = most;
  }
  simulation_.Reset(lane_seed, episode);
  Settle();
  return Status();
}

StepResult Highway::Step(std::span<const double> action, bool single_precision) {
  std::ranges::copy(action, action_.begin());
  simulation_.Step(MapAction(settings_.action, action, single_precision));
  outcome_ = simulation_.Judge();
  if (!traffic().AllFinite() || !std::isfinite(outcome_.reward)) {
    return {.cause = Cause::kNumericalError};
  }
  return {.reward = outcome_.reward,
          .terminated = outcome_.terminated,
          .cause = outcome_.terminated ? Cause::kUnhealthy : Cause::kNone};
}

void Highway::Infos(std::span<double> infos) const {
  double* out = infos.data();
  *out++ = traffic().speed[kEgo];
  *out++ = outcome_.crashed;
  *out++ = outcome_.crashed;
  *out++ = outcome_.right_lane;
  *out++ = outcome_.high_speed;
  *out++ = outcome_.on_road;
  std::copy_n(action_.begin(), settings_.action.size(), out);
}

void Highway::SaveState(std::span<double> state) const {
  state[0] = simulation_.time;
  traffic().Save(state.subspan(1));
}

void Highway::LoadState(std::span<const double> state) {
  simulation_.time = state[0];
  simulation_.traffic.Load(state.subspan(1), settings_.lanes_count);
}

std::vector<double> Highway::Vehicles() const {
  std::vector<double> vehicles(static_cast<size_t>(traffic().count) * kVehicleColumns);
  for (int i = 0; i < traffic().count; ++i) {
    traffic().Get(i, std::span(vehicles).subspan(i * kVehicleColumns, kVehicleColumns));
  }
  return vehicles;
}

NamedState Highway::GetNamedState() const {
  return {{"time", {simulation_.time}}, {"vehicles", Vehicles()}};
}

Status CheckTime(std::span<const double> time) {
  if (time.size() != 1) {
    return InvalidNumber("length of state part 'time'", static_cast<double>(time.size()), "1");
  }
  if (std::abs(time[0]) <= kLargestValue) return Status();
  return InvalidNumber("state part 'time'", time[0], "-1e10..1e10 seconds");
}

Status Highway::CheckVehicles(std::span<const double> vehicles) const {
  const size_t capacity = traffic().capacity();
  if (vehicles.empty() || vehicles.size() % kVehicleColumns != 0 ||
      vehicles.size() > capacity * kVehicleColumns) {
    return InvalidArgument(
        "length of state part 'vehicles'", std::to_string(vehicles.size()),
        fmt::format("{} numbers for each of 1 to {} cars", kVehicleColumns, capacity));
  }
  for (size_t i = 0; i < vehicles.size(); ++i) {
    const size_t row = i / kVehicleColumns;
    const size_t column = i % kVehicleColumns;
    if (!(std::abs(vehicles[i]) <= kLargestValue)) {
      return InvalidNumber(fmt::format("state vehicles[{}][{}]", row, column), vehicles[i],
                           "-1e10..1e10");
    }
    const bool is_lane = column == kColumnLane || (column == kColumnTargetLane && row != kEgo);
    if (is_lane && !(vehicles[i] >= 0 && vehicles[i] < settings_.lanes_count)) {
      return InvalidNumber(fmt::format("lane in state vehicles[{}][{}]", row, column), vehicles[i],
                           fmt::format("0..{}", settings_.lanes_count - 1));
    }
    const bool is_flag = column == kColumnCrashed || column == kColumnImpactPending;
    const bool is_whole = column == kColumnLane || column == kColumnTargetLane;
    if ((is_flag && vehicles[i] != 0 && vehicles[i] != 1) ||
        (is_whole && vehicles[i] != std::floor(vehicles[i]))) {
      return InvalidNumber(fmt::format("state vehicles[{}][{}]", row, column), vehicles[i],
                           is_flag ? "0 or 1" : "whole numbers");
    }
  }
  return Status();
}

Status Highway::SetNamedState(const NamedState& state) {
  static const std::vector<std::string> kParts = {"time", "vehicles"};
  for (const auto& [name, values] : state) {
    if (std::ranges::find(kParts, name) == kParts.end()) {
      return UnknownName("state part", name, kParts);
    }
  }
  const auto vehicles = state.find("vehicles");
  if (vehicles == state.end()) {
    return Status(StatusCode::kInvalidArgument, "state has no part 'vehicles'");
  }
  B4MRL_RETURN_IF_ERROR(CheckVehicles(vehicles->second));
  const auto time = state.find("time");
  if (time != state.end()) B4MRL_RETURN_IF_ERROR(CheckTime(time->second));
  simulation_.time = time == state.end() ? 0 : time->second[0];
  Traffic& cars = simulation_.traffic;
  cars.Clear();
  const std::span<const double> rows = vehicles->second;
  for (size_t at = 0; at < rows.size(); at += kVehicleColumns) {
    cars.Set(cars.count++, rows.subspan(at, kVehicleColumns), settings_.lanes_count);
  }
  Settle();
  return Status();
}

QueryResult Highway::Query(std::span<const double> observation, std::span<const double> action,
                           std::span<double> next_observation) {
  std::ranges::fill(next_observation, 0);
  if (!AllReasonable(observation)) return {};
  if (!TrafficFromObservation(settings_.observation, settings_.lanes_count, observation,
                              simulation_.traffic)) {
    return {};
  }
  simulation_.time = 0;
  const StepResult step = Step(action, false);
  if (step.cause == Cause::kNumericalError) return {};
  Observe(next_observation);
  return {.reward = step.reward, .terminated = step.terminated, .valid = true};
}

Status Highway::Draw(Canvas& canvas) {
  const std::vector<double> vehicles = Vehicles();
  return canvas.DrawPlan(HighwayPlan(static_cast<uint32_t>(settings_.lanes_count), vehicles));
}

SpaceSpec ObservationSpace(const HighwayObservationSettings& settings) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  SpaceSpec space;
  for (size_t row = 0; row < settings.rows; ++row) {
    const std::string who = row == 0 ? "ego" : fmt::format("vehicle{}", row);
    for (const HighwayObservationSettings::Column& column : settings.columns) {
      const std::string feature(FeatureName(column.feature));
      const std::string unit(column.range ? "" : FeatureUnit(column.feature));
      space.dimensions.push_back({.name = fmt::format("{}-{}", who, feature),
                                  .unit = unit,
                                  .low = -kInfinity,
                                  .high = kInfinity,
                                  .feature = feature,
                                  .flag = column.feature == HighwayFeature::kPresence});
    }
  }
  space.shape = {settings.rows, settings.columns.size()};
  return space;
}

// Steps until `duration` is over; the time is summed up step by step, as in highway-env.
uint32_t EpisodeSteps(const HighwaySettings& settings) {
  uint32_t steps = 0;
  double time = 0;
  do {
    time += 1 / settings.policy_frequency;
    ++steps;
  } while (time < settings.duration);
  return steps;
}

EnvironmentSpec Describe(const Config& config) {
  const HighwaySettings settings = ReadHighwaySettings(config);
  EnvironmentSpec spec;
  spec.name = "Highway";
  spec.features.emplace_back(kOtherCars);
  spec.observation = ObservationSpace(settings.observation);
  if (settings.action.longitudinal) spec.action.dimensions.push_back({"throttle", "", -1, 1});
  if (settings.action.lateral) spec.action.dimensions.push_back({"steering", "", -1, 1});
  spec.action.shape = {spec.action.size()};
  spec.reward =
      "collision_reward * crashed + right_lane_reward * lane / (lanes_count - 1) + "
      "high_speed_reward * (speed along the road within reward_speed_range, 0 to 1); mapped to "
      "0..1 if normalize_reward; 0 off the road";
  spec.max_episode_steps = EpisodeSteps(settings);
  spec.step_seconds = 1 / settings.policy_frequency;
  spec.reset_info_names = {"speed",
                           "crashed",
                           "rewards.collision_reward",
                           "rewards.right_lane_reward",
                           "rewards.high_speed_reward",
                           "rewards.on_road_reward"};
  spec.info_names = spec.reset_info_names;
  for (size_t i = 0; i < settings.action.size(); ++i) {
    spec.info_names.push_back(fmt::format("action[{}]", i));
  }
  spec.picture_width = config.at("screen_width").get<uint32_t>();
  spec.picture_height = config.at("screen_height").get<uint32_t>();
  return spec;
}

HighwaySettings SettingsOf(const EnvironmentSetup& setup) {
  HighwaySettings settings = ReadHighwaySettings(setup.config);
  // The setup's configuration has the number of cars at the upper end of its range.
  if (!setup.parameters.empty()) settings.most_vehicles = settings.vehicles_count;
  return settings;
}

class HighwayModel final : public EnvironmentModel {
 public:
  explicit HighwayModel(const EnvironmentSetup& setup)
      : spec_(Describe(setup.config)),
        settings_(SettingsOf(setup)),
        config_under_(setup.config_under) {}

  const EnvironmentSpec& spec() const override { return spec_; }
  std::string Identity() const override {
    // A range of cars once gave other starts, which had random numbers in common, and queries once
    // took cars whose heading they are told to face along the road.
    return fmt::format("highway-env 1.12{}{}", settings_.most_vehicles ? ", starts apart" : "",
                       DescribesHeadings(settings_.observation) ? ", headings queried" : "");
  }
  bool maps_float32() const override { return true; }
  Status CheckQueryable() const override {
    if (DescribesTraffic(settings_.observation)) return Status();
    return Status(StatusCode::kUnsupported,
                  "observations without presence, x, y, vx and vy, or with a features_range that "
                  "shows presence as 0, do not tell the state that a query starts from");
  }
  Result<std::unique_ptr<Environment>> NewEnvironment() const override {
    return std::unique_ptr<Environment>(std::make_unique<Highway>(spec_, settings_, config_under_));
  }

 private:
  EnvironmentSpec spec_;
  HighwaySettings settings_;
  ConfigUnder config_under_;
};

Result<std::shared_ptr<const EnvironmentModel>> Open(const EnvironmentSetup& setup) {
  return std::shared_ptr<const EnvironmentModel>(std::make_shared<HighwayModel>(setup));
}

}  // namespace

extern const EnvironmentEntry kHighway;  // its line in list.cc
constinit const EnvironmentEntry kHighway = {"Highway", CompleteHighwayConfig, Describe, Open};

}  // namespace b4mrl
