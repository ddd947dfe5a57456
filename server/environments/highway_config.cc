#include "server/environments/highway_config.h"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <utility>

#include "server/environments/config_reader.h"
#include "server/highway/observation.h"

namespace b4mrl {
namespace {

constexpr double kLargest = 1e6;  // greatest absolute value of a reward or of the end of a range
// Of a range. A narrower one would map places on the road to numbers beyond float32.
constexpr double kLeastWidth = 1e-9;
// 128 cars in one heap cost 1 ms a frame; a longer step would look like a frozen process.
constexpr double kMaxFramesPerStep = 500;

Status Unsupported(const std::string& key, const Config& value, std::string_view reason) {
  return Status(StatusCode::kUnsupported, fmt::format("{} is {}: {}", key, value.dump(), reason));
}

NumberRange ReadRange(ConfigReader& reader, const std::string& key, const NumberRange& fallback) {
  const Interval range = reader.Range(key, {fallback.low, fallback.high}, RangeEnds::kFinite);
  if (!(std::abs(range.low) <= kLargest && std::abs(range.high) <= kLargest)) {
    reader.Fail(InvalidArgument(key, reader.Find(key)->dump(), "two numbers in -1e6..1e6"));
    return fallback;
  }
  if (!(range.high - range.low >= kLeastWidth)) {
    reader.Fail(InvalidArgument(key, reader.Find(key)->dump(), "[low, high] at least 1e-9 apart"));
    return fallback;
  }
  return {range.low, range.high};
}

// null is the absence of a value, as Python's None.
bool IsNone(ConfigReader& reader, const std::string& key) {
  const Config* found = reader.Find(key);
  if (found != nullptr && !found->is_null()) return false;
  reader.Keep(key, nullptr);
  return true;
}

// A setting that has one supported value.
void ReadFixed(ConfigReader& reader, const std::string& key, const Config& only,
               std::string_view reason) {
  const Config* found = reader.Find(key);
  if (found != nullptr && *found != only) reader.Fail(Unsupported(key, *found, reason));
  reader.Keep(key, only);
}

// Reads the dictionary `key` with `read`, which gets a reader of its own.
template <typename Read>
auto ReadDictionary(ConfigReader& reader, const std::string& key, Read read) {
  const Config* found = reader.Find(key);
  const bool usable = found != nullptr && found->is_object();
  if (found != nullptr && !usable) {
    reader.Fail(InvalidArgument(key, found->dump(), "a dictionary"));
  }
  const Config given = usable ? *found : Config::object();
  ConfigReader inner(given);
  auto result = read(inner);
  if (const Status status = inner.Finish(); !status.ok()) reader.Fail(status.WithContext(key));
  reader.Keep(key, inner.completed());
  return result;
}

HighwayActionSettings ReadAction(ConfigReader& reader) {
  HighwayActionSettings settings;
  reader.Choice("type", {"ContinuousAction"});
  settings.longitudinal = reader.Bool("longitudinal", settings.longitudinal);
  settings.lateral = reader.Bool("lateral", settings.lateral);
  settings.clip = reader.Bool("clip", settings.clip);
  settings.acceleration_range =
      ReadRange(reader, "acceleration_range", settings.acceleration_range);
  settings.steering_range = ReadRange(reader, "steering_range", settings.steering_range);
  if (!IsNone(reader, "speed_range")) {
    settings.speed_range = ReadRange(reader, "speed_range", {0, 1});
  }
  ReadFixed(reader, "dynamical", false, "the tyre model is not simulated");
  if (settings.size() == 0) {
    reader.Fail(Status(StatusCode::kInvalidArgument,
                       "longitudinal and lateral are both false; one of them must be controlled"));
  }
  return settings;
}

using Observation = HighwayObservationSettings;

std::vector<std::string> FeatureNames() {
  std::vector<std::string> names;
  for (int i = 0; i <= static_cast<int>(HighwayFeature::kAngularOffset); ++i) {
    names.emplace_back(FeatureName(static_cast<HighwayFeature>(i)));
  }
  return names;
}

std::vector<Observation::Column> ReadFeatures(ConfigReader& reader) {
  const Config fallback = {"presence", "x", "y", "vx", "vy"};
  const Config* found = reader.Find("features");
  const Config& list = found != nullptr ? *found : fallback;
  reader.Keep("features", list);
  if (!list.is_array() || list.empty()) {
    reader.Fail(InvalidArgument("features", list.dump(), "a list of names"));
    return {};
  }
  const std::vector<std::string> names = FeatureNames();
  std::vector<Observation::Column> columns;
  std::set<std::string> seen;
  for (const Config& item : list) {
    const std::string name = item.is_string() ? item.get<std::string>() : item.dump();
    const auto known = std::ranges::find(names, name);
    if (known == names.end()) {
      reader.Fail(UnknownName("feature", name, names));
      return {};
    }
    if (!seen.insert(name).second) {
      reader.Fail(InvalidArgument("features", list.dump(), "each name once"));
    }
    columns.push_back({static_cast<HighwayFeature>(known - names.begin()), {}});
  }
  return columns;
}

// Reads which observation columns are mapped to [-1, 1], and from which ranges.
void ReadNormalisation(ConfigReader& reader, int lanes, Observation* settings) {
  const double width = 4.0 * lanes;
  const std::vector<std::pair<std::string, NumberRange>> defaults = {
      {"x", {-200, 200}}, {"y", {-width, width}}, {"vx", {-80, 80}}, {"vy", {-80, 80}}};
  const bool normalize = reader.Bool("normalize", true);
  const auto set_range = [&](const std::string& name, const NumberRange& range) {
    for (Observation::Column& column : settings->columns) {
      if (normalize && FeatureName(column.feature) == name) column.range = range;
    }
  };
  const Config* given = reader.Find("features_range");
  const bool is_empty = given != nullptr && given->is_object() && given->empty();
  if (is_empty) reader.Keep("features_range", nullptr);  // which highway-env takes for None
  if (is_empty || IsNone(reader, "features_range")) {
    for (const auto& [name, range] : defaults) set_range(name, range);
    return;
  }
  ReadDictionary(reader, "features_range", [&](ConfigReader& ranges) {
    for (const std::string& name : FeatureNames()) {
      if (ranges.Find(name) != nullptr) set_range(name, ReadRange(ranges, name, {-1, 1}));
    }
    return 0;
  });
}

Observation ReadObservation(ConfigReader& reader, int lanes) {
  Observation settings;
  reader.Choice("type", {"Kinematics"});
  settings.columns = ReadFeatures(reader);
  settings.rows = reader.Integer("vehicles_count", settings.rows, 1, kMaxVehicles);
  ReadNormalisation(reader, lanes, &settings);
  settings.absolute = reader.Bool("absolute", settings.absolute);
  settings.clip = reader.Bool("clip", settings.clip);
  settings.see_behind = reader.Bool("see_behind", settings.see_behind);
  settings.sorted = reader.Choice("order", {"sorted", "unsorted"}) == "sorted";
  ReadFixed(reader, "observe_intentions", false, "cars have no destinations here");
  reader.Bool("include_obstacles", true);  // no effect: the road has no obstacles
  return settings;
}

void ReadRewards(ConfigReader& reader, HighwaySettings* settings) {
  const auto number = [&reader](const char* key, double* value) {
    *value = reader.Number(key, *value, -kLargest, kLargest);
  };
  number("collision_reward", &settings->collision_reward);
  number("right_lane_reward", &settings->right_lane_reward);
  number("high_speed_reward", &settings->high_speed_reward);
  number("on_road_reward", &settings->on_road_reward);
  reader.Number("lane_change_reward", 0, -kLargest, kLargest);  // no effect, as in highway-env
  settings->reward_speed_range =
      ReadRange(reader, "reward_speed_range", settings->reward_speed_range);
  settings->normalize_reward = reader.Bool("normalize_reward", settings->normalize_reward);
  settings->offroad_terminal = reader.Bool("offroad_terminal", settings->offroad_terminal);
  const double span =
      settings->high_speed_reward + settings->right_lane_reward - settings->collision_reward;
  if (settings->normalize_reward && span == 0) {
    reader.Fail(Status(StatusCode::kInvalidArgument,
                       "high_speed_reward + right_lane_reward equals collision_reward, which "
                       "normalize_reward would divide by their difference, 0"));
  }
}

void ReadFrequencies(ConfigReader& reader, HighwaySettings* settings) {
  settings->simulation_frequency =
      reader.Number("simulation_frequency", settings->simulation_frequency, 0.1, 1000);
  settings->policy_frequency =
      reader.Number("policy_frequency", settings->policy_frequency, 0.01, 100);
  settings->duration = reader.Number("duration", settings->duration, 0, 10'000);
  if (settings->simulation_frequency > kMaxFramesPerStep * settings->policy_frequency) {
    reader.Fail(InvalidNumber("simulation_frequency", settings->simulation_frequency,
                              fmt::format("at most {} times policy_frequency, {}",
                                          kMaxFramesPerStep, settings->policy_frequency)));
  }
}

// Reads the settings of highway-env's window. Of these, pictures use the width and height only.
void ReadPictures(ConfigReader& reader) {
  reader.Integer("screen_width", 600, 16, 1920);
  reader.Integer("screen_height", 150, 16, 1920);
  reader.Bool("offscreen_rendering", true);  // no effect: there is no window
  reader.Bool("real_time_rendering", false);
  ReadFixed(reader, "manual_control", false, "actions come from the client");
  ReadFixed(reader, "show_trajectories", false, "pictures show cars, not trajectories");
  // No effect either: the window's part of the road. A setting that is not given is not completed,
  // so that experiment ids are those from before these four were known.
  const auto is_given = [&reader](const char* key) { return reader.Find(key) != nullptr; };
  if (is_given("centering_position")) {
    const Config& place = *reader.Find("centering_position");
    if (!place.is_array() || place.size() != 2 || !place[0].is_number() || !place[1].is_number()) {
      reader.Fail(InvalidArgument("centering_position", place.dump(), "a list of two numbers"));
    }
    reader.Keep("centering_position", place);
  }
  if (is_given("scaling")) reader.Number("scaling", 5.5, 0, kLargest);
  if (is_given("render_agent")) reader.Bool("render_agent", true);
  if (is_given("lock_window")) reader.Bool("lock_window", false);
}

HighwaySettings Defaults(ConfigReader& reader) {
  HighwaySettings settings;
  const bool chosen = reader.Find("env_id") != nullptr;
  if (reader.Choice("env_id", {"highway-fast-v0", "highway-v0"}) == "highway-v0") {
    settings.simulation_frequency = 15;
    settings.lanes_count = 4;
    settings.vehicles_count = 50;
    settings.duration = 40;
    settings.ego_spacing = 2;
    settings.others_check_collisions = true;
  }
  if (!chosen) settings.vehicles_count = 3;
  return settings;
}

HighwaySettings Read(ConfigReader& reader) {
  HighwaySettings settings = Defaults(reader);
  ReadFrequencies(reader, &settings);
  settings.lanes_count =
      static_cast<int>(reader.Integer("lanes_count", settings.lanes_count, 1, kMaxRoadLanes));
  settings.vehicles_count =
      reader.Integer("vehicles_count", settings.vehicles_count, 0, kMaxVehicles - 1);
  ReadFixed(reader, "controlled_vehicles", 1, "one car is controlled");
  settings.ego_spacing = reader.Number("ego_spacing", settings.ego_spacing, 0, 1000);
  settings.vehicles_density =
      reader.Number("vehicles_density", settings.vehicles_density, 0.001, 1000);
  if (!IsNone(reader, "initial_lane_id")) {
    settings.initial_lane_id =
        static_cast<int>(reader.Integer("initial_lane_id", 0, 0, settings.lanes_count - 1));
  }
  ReadRewards(reader, &settings);
  reader.Choice("other_vehicles_type", {"highway_env.vehicle.behavior.IDMVehicle"});
  reader.Bool("neighbour_vehicles_connected_lanes", false);  // no effect: there is one road
  settings.action = ReadDictionary(reader, "action", ReadAction);
  settings.observation = ReadDictionary(reader, "observation", [&](ConfigReader& inner) {
    return ReadObservation(inner, settings.lanes_count);
  });
  ReadPictures(reader);
  return settings;
}

}  // namespace

Result<Config> CompleteHighwayConfig(const Config& config) {
  ConfigReader reader(config);
  Read(reader);
  B4MRL_RETURN_IF_ERROR(reader.Finish());
  return reader.completed();
}

HighwaySettings ReadHighwaySettings(const Config& completed) {
  ConfigReader reader(completed);
  return Read(reader);
}

}  // namespace b4mrl
